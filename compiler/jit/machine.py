"""LLVM IR as text to object code to addresses, by llvmlite. It is imported on use; `available` tells if it is installed."""

from __future__ import annotations

import ctypes
import math
import sys
from collections.abc import Iterable, Mapping
from functools import lru_cache
from importlib.util import find_spec
from typing import Any

# Functions that generated code may call: those of the mathematical library under their names in Python, and those that LLVM itself calls.
LIBRARY = (
    *(name for name, f in vars(math).items() if callable(f)),
    "sincos",
    "memset",
    "memcpy",
    "memmove",
    "malloc",
    "free",
)

_view: Any = (ctypes.c_char * 0).from_buffer  # of arrays without items, too
# Platforms that libraries are made for: LLVM's name of each, and its least processor. Names without `gnu` keep LLVM from calling
# functions that only one C library has, such as `sincos`.
PLATFORMS = {
    "linux64": ("x86_64-unknown-linux", "x86-64"), "linux-aarch64": ("aarch64-unknown-linux", "generic"),
    "win64": ("x86_64-pc-windows-msvc", "x86-64"),
}  # fmt: skip
# Cost up to which level 1 copies a function to its calls, in LLVM's units, which copies up to 225.
LARGEST_INLINED = 25
AS_WRITTEN = -1  # a level: the text with the best instructions, but without optimization passes


@lru_cache
def available() -> bool:
    """Return True if LLVM is installed, without loading it."""
    return find_spec("llvmlite") is not None


class MachineCode:
    """Object code in memory, with its functions by name. Valid as long as this object lives."""

    def __init__(self, *codes: bytes) -> None:
        self._engines = [_engine(code) for code in codes]
        self._kept: list[object] = []

    def keep(self, data: object) -> None:
        """Keep data that the code points to alive as long as the code."""
        self._kept.append(data)

    def address(self, name: str) -> int:
        """Address of a function."""
        for engine in self._engines:
            found = int(engine.get_function_address(name))
            if found:
                return found
        raise KeyError(name)

    def link(self, name: str, address: int) -> None:
        """Let the code, if it calls this function of another module (`Choices.elsewhere`), do it at an address."""
        for engine in self._engines:
            place = engine.get_global_value_address(f"{name}.at")
            if place:
                ctypes.c_uint64.from_address(place).value = address

    def addresses(self, names: Iterable[str]) -> Mapping[str, int]:
        """Addresses of functions."""
        return {name: self.address(name) for name in names}


def address_of(array: Any) -> int:
    """Address of the first item of a numpy array, five times faster than `__array_interface__`, which also gives the type.

    A short run calls it two hundred times.
    """
    try:
        return ctypes.addressof(_view(array))
    except TypeError:  # it is not to be written, or has gaps
        found: int = array.__array_interface__["data"][0]
        return found


def object_code(text: str, level: int, platform: str = "") -> bytes:
    """Object code of a module. `level`: optimization level, 0 to 3, or `AS_WRITTEN`; `platform`: one of `PLATFORMS`, or this machine."""
    from llvmlite import binding

    machine = _machine(2 if level == AS_WRITTEN else level, platform)
    module = binding.parse_assembly(text)
    module.triple, module.data_layout = machine.triple, str(machine.target_data)
    module.verify()
    if level > 0:
        options = binding.create_pipeline_tuning_options(speed_level=level)
        options.slp_vectorization = level > 1  # rounds as before, and takes an eighth off a Jacobian
        options.loop_unrolling = False  # takes as long as all other passes, and runs are no faster
        if level == 1:  # a fifth of the time of the solvers, and their steps are no slower
            options.inlining_threshold = LARGEST_INLINED
        builder = binding.create_pass_builder(machine, options)
        builder.getModulePassManager().run(module, builder)
    return bytes(machine.emit_object(module))


def _engine(code: bytes) -> Any:
    """Load object code into memory: an empty module whose cache returns the code, so that the engine owns all its data."""
    from llvmlite import binding

    machine = _machine(1)  # one for each engine, which owns it
    module = binding.parse_assembly("")
    module.triple, module.data_layout = machine.triple, str(machine.target_data)
    engine = binding.create_mcjit_compiler(module, machine)
    engine.set_object_cache(None, lambda module: code)
    engine.finalize_object()
    return engine


def processor() -> str:
    """Identification of the target: LLVM's version, platform, processor and its features."""
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


def _machine(level: int, platform: str = "") -> Any:
    from llvmlite import binding

    if platform:
        binding.initialize_all_targets()
        binding.initialize_all_asmprinters()
        triple, processor = PLATFORMS[platform]
        return binding.Target.from_triple(triple).create_target_machine(
            cpu=processor, features="", opt=level, reloc="pic", codemodel="small"
        )
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
    """The mathematical library of this process, to which object code is bound directly, without the system's loader."""
    if sys.platform == "win32":
        places = [ctypes.CDLL("ucrtbase")]
    else:
        name = "libm.so.6" if sys.platform == "linux" else None  # elsewhere it is part of the process
        places = [ctypes.CDLL(None), *([ctypes.CDLL(name)] if name else [])]
    for word in LIBRARY:
        for place in places:
            function = getattr(place, word, None)
            if function is not None:
                address = ctypes.cast(function, ctypes.c_void_p).value
                assert address is not None
                yield word, address
                break
