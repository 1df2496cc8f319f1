"""Count the functions and files of ours that a command executes: `python -m tools.count_executed run simulate-touch --executor serial …`.

Comprehensions, generator expressions and lambdas count as functions; bodies of modules and classes do not.
"""

from __future__ import annotations

import inspect
import sys
from collections import Counter
from pathlib import Path
from types import CodeType, FrameType

ROOT = Path(__file__).parents[1]
OURS = ("pipeline", "stages", "schemas")


def main() -> None:
    """Run the command of the arguments, then print the counts by package."""
    from pipeline.cli.app import app

    executed: set[CodeType] = set()

    def note(frame: FrameType, event: str, _: object) -> None:
        if event == "call":
            executed.add(frame.f_code)

    sys.setprofile(note)
    try:
        app(standalone_mode=False)
    finally:
        sys.setprofile(None)
    functions = [(path, code) for code in executed if code.co_flags & inspect.CO_OPTIMIZED and (path := _of_ours(code))]
    named = [code for _, code in functions if not code.co_name.startswith("<")]
    print(f"{len(functions)} functions ({len(named)} named) in {len({path for path, _ in functions})} files")
    for package, count in Counter("/".join(path.parts[:2]) for path, _ in functions).most_common():
        print(f"{count:5} {package}")


def _of_ours(code: CodeType) -> Path | None:
    path = Path(code.co_filename)
    inside = path.relative_to(ROOT) if path.is_relative_to(ROOT) else None
    return inside if inside and inside.parts[0] in OURS else None


if __name__ == "__main__":
    main()
