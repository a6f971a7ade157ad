"""LLVM IR as text -> object code -> addresses, by llvmlite. Imported on use: a machine without it is told so by `available`."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Iterable, Mapping
from functools import lru_cache
from importlib.util import find_spec
from typing import Any

# What generated code calls of the mathematical library.
LIBRARY = (
    "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh", "exp", "log", "log10", "pow",
    "sincos", "memset", "memcpy", "memmove", "malloc", "free",
)  # fmt: skip

_view: Any = (ctypes.c_char * 0).from_buffer  # of arrays without items, too
AS_WRITTEN = -1  # a level: what the text says with the best instructions, but without passes over it


@lru_cache
def available() -> bool:
    """Whether there is an LLVM to compile with, looked up without loading it."""
    return find_spec("llvmlite") is not None


class MachineCode:
    """Object code in memory, by the names of its functions. It lives as long as this object."""

    def __init__(self, *codes: bytes) -> None:
        self._engines = [_engine(code) for code in codes]
        self._kept: list[object] = []

    def keep(self, data: object) -> None:
        """What the code points to lives as long as it."""
        self._kept.append(data)

    def address(self, name: str) -> int:
        """Where a function begins."""
        for engine in self._engines:
            found = int(engine.get_function_address(name))
            if found:
                return found
        raise KeyError(name)

    def addresses(self, names: Iterable[str]) -> Mapping[str, int]:
        """Where functions begin."""
        return {name: self.address(name) for name in names}


def address_of(array: Any) -> int:
    """Where an array of numpy begins, in a fifth of the time of `__array_interface__`, which tells its type as well: a short run asks two
    hundred times."""
    try:
        return ctypes.addressof(_view(array))
    except TypeError:  # it is not to be written, or has gaps
        found: int = array.__array_interface__["data"][0]
        return found


def object_code(text: str, level: int) -> bytes:
    """The object code of a module. `level`: how much is made of it, 0 to 3, or `AS_WRITTEN`."""
    from llvmlite import binding

    machine = _machine(2 if level == AS_WRITTEN else level)
    module = binding.parse_assembly(text)
    module.triple, module.data_layout = machine.triple, str(machine.target_data)
    module.verify()
    if level > 0:
        options = binding.create_pipeline_tuning_options(speed_level=level)
        options.slp_vectorization = True  # rounds as before, and takes an eighth off a Jacobian
        builder = binding.create_pass_builder(machine, options)
        builder.getModulePassManager().run(module, builder)
    return bytes(machine.emit_object(module))


def _engine(code: bytes) -> Any:
    """Object code in memory: an empty module, for which a cache says that its code is known; so the engine owns all that it has."""
    from llvmlite import binding

    machine = _machine(1)  # one for each engine, which owns it
    module = binding.parse_assembly("")
    module.triple, module.data_layout = machine.triple, str(machine.target_data)
    engine = binding.create_mcjit_compiler(module, machine)
    engine.set_object_cache(None, lambda module: code)
    engine.finalize_object()
    return engine


def processor() -> str:
    """What the code is made for."""
    from llvmlite import binding

    _prepare()
    version = ".".join(map(str, binding.llvm_version_info))
    return f"{version} {binding.get_process_triple()} {binding.get_host_cpu_name()} {_features()}"


@lru_cache
def _prepare() -> None:
    from llvmlite import binding

    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    for name, address in _library():
        binding.add_symbol(name, address)


def _machine(level: int) -> Any:
    from llvmlite import binding

    _prepare()
    target = binding.Target.from_triple(binding.get_process_triple())
    return target.create_target_machine(
        cpu=binding.get_host_cpu_name(),
        features=_features(),
        opt=level,
        reloc="default",
        codemodel="jitdefault",
        jit=True,
    )


@lru_cache
def _features() -> str:
    from llvmlite import binding

    return str(binding.get_host_cpu_features().flatten())


def _library() -> Iterable[tuple[str, int]]:
    """The mathematical library of this process: object code is bound to it whatever the system's loader would find."""
    if sys.platform == "win32":
        places = [ctypes.CDLL("ucrtbase")]
    else:
        name = "libm.so.6" if sys.platform == "linux" else None  # elsewhere it is part of what is always there
        places = [ctypes.CDLL(None), *([ctypes.CDLL(name)] if name else [])]
    for word in LIBRARY:
        for place in places:
            function = getattr(place, word, None)
            if function is not None:
                address = ctypes.cast(function, ctypes.c_void_p).value
                assert address is not None
                yield word, address
                break
