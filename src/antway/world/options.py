"""Options of policies that follow their name, as in sipp/predictions=mirrored/margin=0.1."""

from __future__ import annotations

import ast
import inspect
from typing import Any

from antway.errors import BadParameter


def take_options(spec: str, options: dict[str, Any]) -> str:
    """Return the name in NAME/OPTION=VALUE/..., and add its options to the given ones."""
    name, *parts = spec.split("/")
    for part in parts:
        key, equals, text = part.partition("=")
        if not key.isidentifier() or not equals or key in options:
            raise BadParameter("policy", spec, "NAME or MODULE:CLASS, then /OPTION=VALUE once for each option")
        try:
            options[key] = ast.literal_eval(text)
        except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):  # such as {[]: 1}, or a thousand minus signs
            options[key] = text
    return name


def check_options(name: str, kind: Any, options: dict[str, Any]) -> None:
    """Raise `BadParameter` for an option that the policy `kind` does not have, or needs and does not get."""
    try:
        parameters = inspect.signature(kind).parameters.values()
    except (TypeError, ValueError):
        raise BadParameter("policy", name, "a class, or a function that returns a policy") from None
    named = [p for p in parameters if p.kind in (p.KEYWORD_ONLY, p.POSITIONAL_OR_KEYWORD)]
    known = [p.name for p in named]
    if not any(p.kind is p.VAR_KEYWORD for p in parameters):
        for key, value in options.items():
            if key not in known:
                raise BadParameter(key, value, f"left out: the options of policy {name} are {', '.join(known) or 'none'}")
    for p in named:
        if p.default is p.empty and p.name not in options:
            raise BadParameter(p.name, None, f"given: policy {name} needs this option")
