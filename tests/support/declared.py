"""What the tests' studies declare: the example that comes with the software."""

import json
from pathlib import Path

DECLARATIONS_FILE = Path(__file__).parents[2] / "examples" / "declarations.json"
DECLARATIONS = json.loads(DECLARATIONS_FILE.read_text(encoding="utf-8"))
