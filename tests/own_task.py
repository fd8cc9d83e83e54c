"""The README's example of a task of one's own, as a file outside of the package."""

import re
from pathlib import Path

README = Path(__file__).parents[1] / "README.md"
FIRST_LINE = "# detumble.py"


def blocks():
    """The Python examples of the README."""
    return re.findall(r"```python\n(.*?)```", README.read_text(), re.DOTALL)


def write_own_task(folder):
    """Write the example into a folder as a user would."""
    (text,) = (block for block in blocks() if block.startswith(FIRST_LINE))
    (folder / "detumble.py").write_text(text)
