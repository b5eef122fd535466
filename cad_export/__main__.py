"""`python -m cad_export SCRIPT.py --set cells=23 --out DIR`: write the mechanism that a script draws."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; 0 when written, 1 when the script or its drawing failed, 2 on bad arguments."""
    parser = argparse.ArgumentParser(prog="python -m cad_export", description=__doc__)
    parser.add_argument("script", help="a Python file that defines `def design(...) -> Drawing`")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="a setting of design")
    parser.add_argument("--out", default="out", help="folder for mechanism.json and meshes/ (default: out)")
    parser.add_argument("--json", action="store_true", help="print the report as JSON")
    given = parser.parse_args(arguments)
    pairs = [pair.partition("=") for pair in given.set]
    if wrong := [name for name, equals, _ in pairs if not equals]:
        parser.error(f"--set {wrong[0]}: write NAME=VALUE")

    from backend.mechanism.drawing_error import DrawingError  # after --help: CadQuery takes seconds to import
    from backend.mechanism.read import read_mechanism
    from cad_export.script import export_script

    try:
        path = export_script(given.script, given.out, {name: value for name, _, value in pairs})
    except DrawingError as error:
        print(error, file=sys.stderr)
        return 1
    except OSError as error:
        print(f"{error.filename or given.out}: {error.strerror or error}; choose another --out", file=sys.stderr)
        return 1
    mechanism = read_mechanism(path)
    counts = {part: len(getattr(mechanism, part)) for part in ("bodies", "joints", "effects", "markers")}
    warnings = mechanism.provenance.warnings if mechanism.provenance else ()
    if given.json:
        print(json.dumps({"mechanism": str(path), **counts, "warnings": list(warnings)}))
        return 0
    print(f"{mechanism.name}: " + ", ".join(f"{count} {part}" for part, count in counts.items()))
    for warning in warnings:
        print(f"warning: {warning}")
    print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
