"""Run a design script with settings: `design(cells: int = 10) -> Drawing`."""

from __future__ import annotations

import contextlib
import importlib.util
import inspect
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

from backend.mechanism.drawing_error import DrawingError, known
from cad_export.drawing import Drawing

MODULE = "linktwin_design"
YES_NO = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}


def export_script(script_path: str | Path, out_dir: str | Path, settings: Mapping[str, Any] | None = None) -> Path:
    """Run a script's `design` with settings and write what it draws; the path of the mechanism.json.

    settings: by the name of an argument of `design`, as text or as a value of its type (int, float, bool, str).
    Raises DrawingError when the script fails, naming its line, and on unknown or unsuitable settings, listing the
    known ones; OSError when the folder cannot be made. What the script prints goes to stderr, so that a report on
    stdout stays whole.
    """
    drawing = draw(script_path, settings)
    Path(out_dir).mkdir(parents=True, exist_ok=True)  # not the script's fault where it fails
    with _blaming(Path(script_path)):
        return drawing.write(out_dir)


def draw(script_path: str | Path, settings: Mapping[str, Any] | None = None) -> Drawing:
    """The drawing that a script's `design` returns."""
    path = Path(script_path)
    with _loaded(path) as module:
        design = getattr(module, "design", None)
        if not callable(design):
            raise DrawingError("defines no design(...); write `def design() -> Drawing:`", str(path))
        arguments = _arguments(design, settings or {}, str(path))
        with _blaming(path):
            drawing = design(**arguments)
    if not isinstance(drawing, Drawing):
        raise DrawingError(f"design(...) returned {type(drawing).__name__}; return the Drawing", str(path))
    return drawing


@contextlib.contextmanager
def _loaded(path: Path) -> Iterator[ModuleType]:
    """The script as a module, with its folder importable while it runs."""
    if not path.is_file():
        raise DrawingError("is not a file; check the path", str(path))
    spec = importlib.util.spec_from_loader(MODULE, loader=None, origin=str(path))
    if spec is None:
        raise DrawingError("cannot be loaded; give a Python file", str(path))
    module = importlib.util.module_from_spec(spec)
    module.__file__ = str(path.resolve())
    folder = str(path.resolve().parent)
    sys.modules[MODULE] = module
    sys.path.insert(0, folder)
    try:
        with _blaming(path):
            exec(compile(path.read_bytes(), module.__file__, "exec"), module.__dict__)
        yield module
    finally:
        sys.modules.pop(MODULE, None)
        if folder in sys.path:
            sys.path.remove(folder)


@contextlib.contextmanager
def _blaming(path: Path) -> Iterator[None]:
    """Turn whatever a script raises into a DrawingError that names the script's line."""
    try:
        with contextlib.redirect_stdout(sys.stderr):
            yield
    except DrawingError as error:
        raise DrawingError(error.problems, _place(path, error)) from error
    except (Exception, SystemExit) as error:
        what = f"{type(error).__name__}: {error}"
        raise DrawingError(f"{what}; correct the script there", _place(path, error)) from error


def _place(path: Path, error: BaseException) -> str:
    if isinstance(error, SyntaxError) and error.lineno:
        return f"{path}, line {error.lineno}"
    own = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path.resolve())]
    return f"{path}, line {own[-1].lineno}" if own else str(path)


def _arguments(design: Callable[..., Any], settings: Mapping[str, Any], source: str) -> dict[str, Any]:
    with _blaming(Path(source)):
        parameters = inspect.signature(design, eval_str=True).parameters
    gathering = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    declared = {name: each for name, each in parameters.items() if each.kind not in gathering}
    problems = [
        f'setting "{name}" is unknown to design. {known(declared)}' for name in settings if name not in declared
    ]
    arguments: dict[str, Any] = {}
    for name, parameter in declared.items():
        if name in settings:
            try:
                arguments[name] = _converted(settings[name], _type(parameter))
            except (TypeError, ValueError) as error:
                problems.append(f'setting "{name}" is {settings[name]!r}; {error}. {_known(declared)}')
        elif parameter.default is parameter.empty:
            problems.append(f'setting "{name}" has no default; give it: --set {name}=... {_known(declared)}')
    if problems:
        raise DrawingError(problems, source)
    return arguments


def _type(parameter: inspect.Parameter) -> type:
    if parameter.annotation is not parameter.empty:
        return parameter.annotation
    return str if parameter.default in (parameter.empty, None) else type(parameter.default)


def _converted(value: Any, wanted: type) -> Any:
    if wanted is bool:
        if isinstance(value, bool):
            return value
        if str(value).lower() in YES_NO:
            return YES_NO[str(value).lower()]
        raise ValueError("write true or false")
    if wanted is int and not isinstance(value, bool):
        try:
            return int(str(value))
        except ValueError:
            raise ValueError("write a whole number") from None
    if wanted is float and not isinstance(value, bool):
        try:
            return float(value)
        except (TypeError, ValueError):
            raise ValueError("write a number") from None
    if wanted is str:
        return str(value)
    raise TypeError(f"design declares it as {wanted}; declare settings as int, float, bool or str")


def _known(declared: Mapping[str, inspect.Parameter]) -> str:
    shown = [
        f"{name}: {getattr(_type(each), '__name__', _type(each))}"
        + ("" if each.default is each.empty else f" = {each.default}")
        for name, each in declared.items()
    ]
    return f"Known: {', '.join(shown)}."
