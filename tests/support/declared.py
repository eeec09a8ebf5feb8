"""What the tests' studies declare: the example that comes with the software."""

import tomllib
from pathlib import Path

DECLARATIONS_FILE = Path(__file__).parents[2] / "examples" / "declarations.toml"
DECLARATIONS = tomllib.loads(DECLARATIONS_FILE.read_text(encoding="utf-8"))
