"""Record of a user's own controller, and restoring the controller from it.

A run folder contains the name of the class and the source text for a reader, but this text is never executed:
the class is imported from the user's path, and only if the source found there is the recorded one.
"""

import hashlib
import importlib
import importlib.util
import inspect
import pickle
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from twin_gait.control.controller import Controller
from twin_gait.exceptions import ParameterError

_PACKAGE = __name__.partition(".")[0]
_RUN_FILES = ("experiment.yaml", "summary.json")  # Files that identify a run folder.
_PLAIN = (bool, int, float, str, type(None))
_TUPLE, _ARRAY = "__tuple__", "__array__"  # Keys for types that YAML does not have.


@dataclass(frozen=True, kw_only=True)
class UserController:
    """Record of a controller that was passed to ``simulate``."""

    name: str  # Name in messages.
    module: str  # Module of the class.
    class_name: str  # Name of the class in the module.
    other_modules: tuple[str, ...] = ()  # Further modules of the user that have base classes or the tick.
    source: str = ""  # Source text of these modules.
    source_sha256: str = ""  # SHA-256 of the text.
    # Values of the instance by name; None if a file cannot hold them.
    attributes: Mapping[str, Any] | None = field(default_factory=dict)
    attributes_sha256: str = ""  # SHA-256 of values that a file cannot hold; empty if there is none.
    constants: Mapping[str, Any] = field(default_factory=dict)  # Numbers of the classes and modules.

    @property
    def summary(self) -> dict[str, str]:
        """Entry of ``summary.json``."""
        about = {"name": self.name, "module": self.module, "class": self.class_name}
        return {**about, "source_sha256": self.source_sha256}


def record_controller(controller: Controller) -> UserController:
    """Record the present state of a controller, before a run."""
    kind, modules = type(controller), _modules_of(controller)
    attributes, digest = None, ""
    try:
        attributes = {name: _encoded(value) for name, value in _state(controller).items()}
    except TypeError:
        digest = _state_hash(controller)
    source = _joined({name: _loaded_text(name) for name in modules}) or _text_of_methods(kind)
    return UserController(
        name=controller.name,
        module=modules[0],
        class_name=kind.__qualname__,
        other_modules=modules[1:],
        source=source,
        source_sha256=_sha256(source),
        attributes=attributes,
        attributes_sha256=digest,
        constants=_constants(kind, modules),
    )


def load_controller(path: Path, class_name: str = "") -> Controller:
    """Import a Python file and create a controller of one of its classes, without arguments.

    Args:
        path: File of the module. Its folder is added to the import path of this process.
        class_name: Name of the class; empty for the only class of the file that is derived from Controller.

    Raises:
        ParameterError: If the file cannot be imported, or has no such class or several ones.
    """
    if not path.is_file():
        raise ParameterError(f"{path}: there is no such file; expected a Python file with a controller")
    folder = str(path.resolve().parent)
    if folder not in sys.path:
        sys.path.insert(0, folder)
    try:
        module = importlib.import_module(path.stem)
        if Path(str(module.__file__)).resolve() != path.resolve():
            raise ParameterError(f"{path}: there is another module {path.stem!r}; rename the file")
        kinds = {
            name: item
            for name, item in vars(module).items()
            if isinstance(item, type) and issubclass(item, Controller) and item.__module__ == path.stem
        }
        if (class_name or len(kinds) != 1) and class_name not in kinds:
            known = ", ".join(kinds) or "none"
            raise ParameterError(f"{path}: expected FILE.py:CLASS with a controller of it ({known})")
        made: Controller = kinds[class_name or next(iter(kinds))]()
    except ParameterError:
        raise
    except Exception as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise ParameterError(f"{path}: the controller cannot be created ({reason[:200]})") from error
    return made


def restore_controller(record: UserController) -> Controller:
    """Import the class of a record and create the controller again.

    Raises ParameterError if the class cannot be imported, has another source, or cannot be created with
    exactly the recorded attributes.
    """
    modules = (record.module, *record.other_modules)
    if record.module == "__main__" or "<locals>" in record.class_name:
        where = "a function" if "<locals>" in record.class_name else "a script or notebook"
        _reject(record, f"was defined in {where}, from which it cannot be imported; define it in a module")
    texts = {name: _found_text(record, name) for name in modules}
    if _sha256(_joined(texts)) != record.source_sha256:
        _reject(record, f"the source of {' or '.join(modules)} has changed since; restore it")
    try:
        found: Any = importlib.import_module(record.module)
        for part in record.class_name.split("."):
            found = getattr(found, part)
    except Exception as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        _reject(record, f"cannot be imported from {record.module} ({reason[:200]})")
    if not (isinstance(found, type) and issubclass(found, Controller)):
        _reject(record, f"{record.module}.{record.class_name} is not a class derived from Controller")
    constants = _constants(found, modules)
    for name in sorted({*constants, *record.constants}):
        then, now = (item.get(name, "not set") for item in (record.constants, constants))
        if then != now:
            _reject(record, f"{name} was {then} in the run and is {now} now; restore it")
    return _remade(found, record)


def _remade(kind: type[Controller], record: UserController) -> Controller:
    """Return an instance with the attributes of the record."""
    if record.attributes is not None:
        made = object.__new__(kind)
        for name, value in record.attributes.items():
            object.__setattr__(made, name, _decoded(value))
        return made
    try:
        made = kind()
    except TypeError:
        _reject(record, "was created with arguments that cannot be stored in a file")
    if not record.attributes_sha256 or _state_hash(made) != record.attributes_sha256:
        _reject(record, "has attributes that a file cannot store and that are not those of a new instance")
    return made


def _reject(record: UserController, problem: str) -> NoReturn:
    call = f"simulate(load_experiment(RUN).experiment, controller={record.class_name.split('.')[-1]}(…))"
    way_out = f"pass it in Python: {call}, or set controller=null to run control.mode"
    raise ParameterError(f"controller {record.name!r}: {problem}; or {way_out}")


# ------------------------------------------------------------------ source


def _modules_of(controller: Controller) -> tuple[str, ...]:
    """Return the module of the class, and the user's modules of its bases and functions."""
    bases = (base.__module__ for base in _own_classes(type(controller)))
    functions = (
        getattr(item, "__module__", None) or _PACKAGE for item in controller.tick_functions().values()
    )
    others = (name for name in (*bases, *functions) if name.partition(".")[0] != _PACKAGE)
    return tuple(dict.fromkeys((type(controller).__module__, *others)))


def _own_classes(kind: type[Controller]) -> Iterator[type[Any]]:
    """Yield a class and its bases, without those of this package and of Python."""
    return (item for item in kind.__mro__ if item.__module__.partition(".")[0] not in (_PACKAGE, "builtins"))


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def _joined(texts: Mapping[str, str]) -> str:
    """Join the texts of modules; the text of a single module is unchanged."""
    if len(texts) == 1:
        return next(iter(texts.values()))
    return "".join(f"# module {name}\n{text}" for name, text in texts.items())


def _text_of(spec: ModuleSpec | None) -> str:
    """Return the source text of a module; empty if it has none."""
    if spec is None or spec.loader is None:
        return ""
    loader: Any = spec.loader
    if not hasattr(loader, "get_source"):  # The loader of a tool that modifies code.
        loader = SourceFileLoader(spec.name, spec.origin or "")
    try:
        return loader.get_source(spec.name) or ""
    except (ImportError, OSError, SyntaxError):
        return ""


def _loaded_text(name: str) -> str:
    """Return the source text of a module that is loaded, such as ``__main__``."""
    module = sys.modules.get(name)
    try:
        return _text_of(getattr(module, "__spec__", None)) or inspect.getsource(module)  # type: ignore[arg-type]
    except (OSError, TypeError):
        return ""


def _text_of_methods(kind: type[Any]) -> str:
    """Return the source of the functions of a class without a file, as in a notebook."""
    found = []
    for item in vars(kind).values():
        try:
            found.append(inspect.getsource(getattr(item, "__func__", item)))
        except (OSError, TypeError):
            continue
    return "\n".join(found)


def _found_text(record: UserController, name: str) -> str:
    """Find a module on the path and return its source text, without executing it or a package around it."""
    spec, search_path = None, None
    try:
        for depth, _ in enumerate(parts := name.split("."), start=1):
            part = ".".join(parts[:depth])
            spec = importlib.util.find_spec(part) if depth == 1 else PathFinder.find_spec(part, search_path)
            search_path = getattr(spec, "submodule_search_locations", None)
    except (ImportError, ValueError):
        spec = None
    text = _text_of(spec)
    if spec is None or not text:
        _reject(record, f"module {name} is not found; put its folder on PYTHONPATH")
    for folder in Path(spec.origin or "").resolve().parents:
        if all((folder / file).is_file() for file in _RUN_FILES):
            _reject(record, f"module {name} is in the run folder {folder}, whose code is never executed")
    return text


# ------------------------------------------------------------------ attributes


def _state(controller: Controller) -> dict[str, Any]:
    """Return the attributes of an instance, those in slots included."""
    state = object.__getstate__(controller)  # type: ignore[attr-defined, unused-ignore]
    parts = state if isinstance(state, tuple) else (state,)
    return {name: value for part in parts for name, value in (part or {}).items()}


def _state_hash(controller: Controller) -> str:
    """Return the hash of attributes that a file cannot hold; empty if they cannot be compared."""
    try:
        return hashlib.sha256(pickle.dumps(_state(controller), protocol=4)).hexdigest()
    except Exception:
        return ""


def _encoded(value: Any) -> Any:
    """Return a value as YAML holds it; TypeError if it cannot be restored exactly."""
    if type(value) in _PLAIN:
        return value
    if type(value) is list:
        return [_encoded(item) for item in value]
    if type(value) is tuple:
        return {_TUPLE: [_encoded(item) for item in value]}
    if type(value) is dict and all(type(key) is str and not key.startswith("__") for key in value):
        return {key: _encoded(item) for key, item in value.items()}
    if type(value) is np.ndarray or isinstance(value, np.generic):
        if value.dtype.kind in "biuf" and value.dtype.itemsize <= 8:
            return {
                _ARRAY: value.tolist(),
                "dtype": str(value.dtype),
                "scalar": isinstance(value, np.generic),
            }
    raise TypeError


def _decoded(value: Any) -> Any:
    """Return the value that :func:`_encoded` wrote."""
    if isinstance(value, list):
        return [_decoded(item) for item in value]
    if not isinstance(value, dict):
        return value
    if _TUPLE in value:
        return tuple(map(_decoded, value[_TUPLE]))
    if _ARRAY in value:
        array = np.array(value[_ARRAY], dtype=value["dtype"])
        return array[()] if value["scalar"] else array
    return {key: _decoded(item) for key, item in value.items()}


def _constants(kind: type[Any], modules: tuple[str, ...]) -> dict[str, Any]:
    """Return the numeric attributes of a class, and the numeric constants in capitals of its modules."""
    found = {
        f"{item.__qualname__}.{name}": value
        for item in reversed([*_own_classes(kind)])
        for name, value in vars(item).items()
        if type(value) in (bool, int, float) and not name.startswith("__")
    }
    for module in modules:
        for name, value in vars(sys.modules[module]).items() if module in sys.modules else ():
            if type(value) in (bool, int, float) and name.isupper():
                found[f"{module}.{name}"] = value
    return found
