"""placeholder"""
from dataclasses import dataclass
@dataclass(frozen=True)
class Immune:
    def apply(self, colony): ...
