"""The README as the package index shows it: there its links lead to the repository, for the index has no other files."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

PAGES = "https://github.com/antway/antway/blob/main/"
PICTURES = "https://raw.githubusercontent.com/antway/antway/main/"


class CustomMetadataHook(MetadataHookInterface):
    """Turns relative links of the README into absolute ones."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Set the README."""
        text = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        text = re.sub(r"(!\[[^\]]*\]\()(?!\w+:)", rf"\1{PICTURES}", text)
        text = re.sub(r"((?<!!)\[[^\]]*\]\()(?!\w+:|#)", rf"\1{PAGES}", text)
        metadata["readme"] = {"content-type": "text/markdown", "text": text}
