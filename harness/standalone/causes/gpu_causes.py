"""Explain builds for a GPU that do not fit: the GPU, its driver, CUDA, cuDNN, and the plugins of JAX."""

from __future__ import annotations

import re
from typing import Any, List, Optional, Tuple

from ..versions import version as parsed
from .scene import Cause, Causes, Pattern, Scene

ARCHITECTURE = Pattern(
    r"no kernel image is available for execution on the device|with CUDA capability sm_\d+ is not compatible"
    r"|PyTorch (?:install|installation) supports CUDA capabilities",
    "no kernel image", "CUDA capabilit",
)  # fmt: skip
DRIVER_OLD = Pattern(
    r"NVIDIA driver on your system is too old(?: \(found version (\d+)\))?|CUDA driver version is insufficient"
    r"|requires a newer (?:CUDA|NVIDIA) driver|unsupported toolchain|provided PTX was compiled with an unsupported",
    "driver", "toolchain", "PTX",
)  # fmt: skip
NO_DRIVER = Pattern(
    r"Found no NVIDIA driver|libcuda\.so(?:\.1)?: cannot open|libnvidia-ml\.so\S*: cannot open"
    r"|NVIDIA-SMI has failed because it couldn't communicate|No CUDA GPUs are available|CUDA_ERROR_NO_DEVICE"
    r"|could not select device driver \W*nvidia|no CUDA-capable device is detected",
    "NVIDIA", "libcuda", "libnvidia", "No CUDA GPUs", "NO_DEVICE", "nvidia", "CUDA-capable",
)  # fmt: skip
CPU_ONLY = Pattern(r"Torch not compiled with CUDA enabled|torch\.cuda\.is_available\(\) (?:is|should be) ", "orch")
MISMATCH = Pattern(
    r"detected CUDA version \((\d[\d.]*)\) mismatches the version that was used to compile PyTorch \((\d[\d.]*)\)",
    "mismatches the version",
)
CUDNN = Pattern(
    r"Loaded runtime CuDNN library: (\d+(?:\.\d+)*) but source was compiled with: (\d+(?:\.\d+)*)|Unable to load cuDNN"
    r"|libcudnn\w*\.so\.?[\d.]*: (?:cannot open|undefined)|DNN library initialization failed"
    r"|CUDNN_STATUS_NOT_INITIALIZED|DNN library is not found",
    "CuDNN", "cuDNN", "libcudnn", "DNN library", "CUDNN",
)  # fmt: skip
NVJITLINK = Pattern(r"libcus(?:parse|olver)\.so[.\d]*: undefined symbol: __nvJitLink", "__nvJitLink")
RUNTIME = Pattern(
    r"(lib(?:cudart|cublas|cublasLt|cufft|cusparse(?!Lt)|cusolver|curand|nvrtc|nvToolsExt|nccl)\S*\.so\.(\d+)[\d.]*)"
    r": cannot open",
    "cannot open shared object",
)
NUMBERED = re.compile(r"lib(?:cudart|cublas(?:Lt)?|nvrtc)\b")
"""Libraries whose number is that of CUDA."""

NVCC = Pattern(
    r"CUDA_HOME environment variable is not set|nvcc(?:'|\"|`)?:? (?:command )?not found|No such file.*nvcc'?$",
    "CUDA_HOME",
    "nvcc",
)
JAX_PLUGIN = Pattern(
    r"JAX plugin (jax_\w+_plugin) version (\d\S*) is installed, but it is not compatible with the installed jaxlib"
    r" version (\d[\w.]*)", "JAX plugin",
)  # fmt: skip
JAXLIB = Pattern(
    r"jaxlib version (\d[\w.]*) is newer than and incompatible with jax version (\d[\w.]*)"
    r"|jaxlib is version (\d[\w.]*), but this version of jax requires version >= ?(\d[\w.]*\w)"
    r"|jax requires jaxlib to be installed",
    "jaxlib",
)
JAX_CPU = Pattern(
    r"CUDA-enabled jaxlib is not installed|Unknown backend:? '?(?:cuda|gpu)|Unable to initialize backend '(?:cuda|gpu)'"
    r"|No GPU/TPU found, falling back to CPU|jaxlib.*is not built with CUDA",
    "jaxlib", "backend", "No GPU/TPU",
)  # fmt: skip
JAX_ERROR = re.compile(r"Error|error|failed|Falling back|falling back|not installed")
TORCH_SYMBOL = Pattern(
    r"undefined symbol: _ZN(?:K?2at|K?3c10|K?5torch|2at|3c10|5torch)\w*|undefined symbol: \S*(?:torch|c10|at6)",
    "undefined symbol",
)
CAPABILITY = re.compile(r"sm_(\d+)")
BUILDS: Tuple[Tuple[int, str, str], ...] = (
    (120, "torch>=2.7", "RTX 50 and RTX PRO Blackwell (sm_120) need torch 2.7 or newer, built for CUDA 12.8 (cu128)"),
    (100, "torch>=2.7", "B100 and B200 (sm_100) need torch 2.7 or newer, built for CUDA 12.8 (cu128)"),
    (90, "torch>=2.0", "H100 (sm_90) needs torch 2.0 or newer, built for CUDA 11.8 or newer"),
    (86, "torch>=1.8", "RTX 30 (sm_86) needs torch 1.8 or newer, built for CUDA 11.1 or newer"),
    (80, "torch>=1.7", "A100 (sm_80) needs torch 1.7 or newer, built for CUDA 11.0 or newer"),
)
"""Compute capabilities, the torch that knows them, and why."""

COMPILED = Pattern(r"nvcc fatal\s*: Unsupported gpu architecture 'compute_(\d+)\w?'", "Unsupported gpu architecture")
REMOVED = ((35, "11.0"), (50, "12.0"), (75, "13.0"))
"""The CUDA since which there is no code for capabilities below a number (CUDA's release notes)."""

OLDEST_KEPT = 75
"""The least capability of CUDA 13."""

BROUGHT = (
    (121, "12.9"), (120, "12.8"), (103, "12.9"), (100, "12.8"), (89, "11.8"), (87, "11.4"), (86, "11.1"), (80, "11.0"),
    (75, "10.0"),
)  # fmt: skip
"""The first CUDA with code for a capability, or for those above it (CUDA's release notes)."""

INSTALL = "Install it with `--index-url` of PyTorch's wheels for that CUDA, as pytorch.org/get-started says."


def causes(line: str, scene: Scene) -> Causes:
    """Yield the cause where a line says that a build does not fit the GPU, its driver or a library of CUDA."""
    for rule in (_architecture, _driver, _compiled, _build, _cudnn, _jax, _symbol):
        cause = rule(line, scene)
        if cause is not None:
            yield cause
            return


def _architecture(line: str, scene: Scene) -> Optional[Cause]:
    if not ARCHITECTURE.search(line):
        return None
    if scene.speaks_of("isaacgym", "isaacgymenvs", "gymapi", "carb.gym.plugin"):
        text = "Isaac Gym's own kernels, or this build of torch, have no code for this GPU"
        return Cause("isaacgym", text, {"text": "Use another GPU, or Isaac Lab, the successor of Isaac Gym."})
    device = re.search(r"capability sm_(\d+) is not compatible", scene.failure.text)
    listed = re.search(r"supports CUDA capabilities ([\w ]+)", scene.failure.text)
    listed_numbers = [int(each) for each in CAPABILITY.findall(listed.group(1))] if listed else []
    own = int(device.group(1)) if device else None
    if own is not None and listed_numbers and own < min(listed_numbers):
        text = "this GPU (sm_{}) is older than every GPU that this build of torch has code for".format(own)
        return Cause("torch", text, {"text": "Install an older torch, built for an older CUDA. " + INSTALL})
    if own is None and listed_numbers:
        own = next((least for least, _, _ in reversed(BUILDS) if least > max(listed_numbers)), None)
    fitting = next((build for build in BUILDS if own is not None and own >= build[0]), None)
    text = "this build of torch has no code for this GPU"
    if fitting is None:
        more = "For RTX 50 (sm_120): `torch>=2.7` built for CUDA 12.8 (cu128). "
        return Cause("torch", text + ": it is newer, or older, than the build knows", {"text": more + INSTALL})
    named = "" if device else ", which is newer than those that it lists"
    return Cause("torch", "{}{}; {}".format(text, named, fitting[2]), {"requirements": [fitting[1]], "text": INSTALL})


def _driver(line: str, scene: Scene) -> Optional[Cause]:
    old = DRIVER_OLD.search(line)
    if old:
        number = old.group(1)
        cuda = "{}.{}".format(int(number) // 1000, int(number) % 1000 // 10) if number else ""
        text = "the NVIDIA driver is older than the CUDA that this build was made for" + (
            "; it serves CUDA {} at most".format(cuda) if cuda else ""
        )
        way = "Update the NVIDIA driver, or install a build for {}.".format("CUDA " + cuda if cuda else "an older CUDA")
        return Cause("nvidia-driver", text, {"text": way})
    if NO_DRIVER.search(line):
        return Cause(
            "nvidia-driver",
            "no NVIDIA GPU or driver can be reached from this process (libcuda comes with the driver, not with CUDA)",
            {
                "text": "Check `nvidia-smi`; install the NVIDIA driver, start a container with `--gpus all`, and look"
                " at CUDA_VISIBLE_DEVICES."
            },
        )
    return None


def _build(line: str, scene: Scene) -> Optional[Cause]:
    mismatch, runtime = MISMATCH.search(line), RUNTIME.search(line)
    if CPU_ONLY.search(line) and "not compiled" in line:
        text = "the installed torch is a build for the CPU"
        return Cause("torch", text, {"text": "Remove torch, and install a CUDA build of it. " + INSTALL})
    if mismatch:
        here, built = mismatch.groups()
        text = "the CUDA compiler here is {}, and the installed torch was built for CUDA {}".format(here, built)
        way = "Install the CUDA toolkit {} and set CUDA_HOME, or a torch built for CUDA {}.".format(built, here)
        return Cause("cuda-toolkit", text, {"text": way})
    if NVCC.search(line):
        text = "the build compiles code for CUDA and finds no CUDA toolkit (nvcc)"
        way = "Install the toolkit of torch's own CUDA (`conda install -c nvidia cuda-toolkit`) and set CUDA_HOME."
        return Cause("cuda-toolkit", text, {"text": way})
    if NVJITLINK.search(line):
        text = "a library of CUDA meets an nvJitLink of another release; LD_LIBRARY_PATH names another CUDA first"
        return Cause(
            "nvidia-nvjitlink",
            text,
            {"environment": {"LD_LIBRARY_PATH": ""}, "text": "Or install all nvidia-*-cu12 packages in one call."},
        )
    if runtime:
        library, number = runtime.groups()
        # The others are numbered by themselves: cuFFT 10 is part of CUDA 10 and 11.
        release = " " + number if NUMBERED.match(library) else ""
        text = "`{}` belongs to CUDA{}, and is not on this machine or not where it is looked for".format(
            library, release
        )
        way = "Install the build of the package for the CUDA that is here, or the libraries of CUDA{}.".format(release)
        return Cause("cuda-libraries", text, {"text": way})
    return None


def _cudnn(line: str, scene: Scene) -> Optional[Cause]:
    match = CUDNN.search(line)
    if match is None:
        return None
    loaded, wanted = match.groups()
    if loaded and wanted:
        major = wanted.split(".")[0]
        package = "nvidia-cudnn-cu12" if int(major) >= 9 or scene.speaks_of("cu12", "cuda12") else "nvidia-cudnn-cu11"
        bound = "{}>={},<{}".format(package, ".".join(wanted.split(".")[:2]), int(major) + 1)
        text = "cuDNN {} was loaded, and the program was built for cuDNN {}".format(loaded, wanted)
        way = "If LD_LIBRARY_PATH names another cuDNN, unset it."
        return Cause("cudnn", text, {"requirements": [bound], "text": way})
    text = "cuDNN was not loaded, or does not fit the CUDA and the driver here"
    way = "Install `nvidia-cudnn-cu12` of the version that jax or torch names, and unset LD_LIBRARY_PATH."
    return Cause("cudnn", text, {"text": way})


def _jax(line: str, scene: Scene) -> Optional[Cause]:
    plugin, jaxlib = JAX_PLUGIN.search(line), JAXLIB.search(line)
    if plugin:
        package, version, there = plugin.group(1).replace("_", "-"), plugin.group(2).rstrip(",."), plugin.group(3)
        text = "{} {} and jaxlib {} differ; all parts of JAX must have the same release".format(
            package, version, there.rstrip(".,")
        )
        cuda = re.sub(r"^jax-(\w+)-plugin$", r"\1", package)
        newer = max((version, there.rstrip(".,")), key=_key)
        return Cause("jax", text, {"requirements": ["jax[{}]=={}".format(cuda, newer)]})
    if jaxlib:
        newer, old, lib, least = jaxlib.groups()
        if newer:
            text = "jaxlib {} is newer than jax {}, and they have to fit".format(newer, old)
            return Cause("jax", text, {"requirements": ["jax=={}".format(newer), "jaxlib=={}".format(newer)]})
        if least:
            text = "jax needs jaxlib {} or newer, and jaxlib {} is installed".format(least, lib)
            return Cause("jaxlib", text, {"requirements": ["jaxlib>={}".format(least)]})
        return Cause("jaxlib", "jaxlib, the compiled part of JAX, is not installed", {"requirements": ["jax[cpu]"]})
    if (
        JAX_CPU.search(line)
        and JAX_ERROR.search(line)
        and scene.speaks_of("jax", "jaxlib", "xla_bridge", "PJRT", "XLA")
    ):
        text = "this JAX is the build for the CPU, or its CUDA plugin does not load"
        return Cause(
            "jax", text, {"requirements": ["jax[cuda12]"], "text": "JAX needs an NVIDIA driver of 525 or newer."}
        )
    return None


def _compiled(line: str, scene: Scene) -> Optional[Cause]:
    """Return the side on which the CUDA compiler is that does not know a capability."""
    match = COMPILED.search(line)
    if match is None:
        return None
    capability = int(match.group(1))
    name = "sm_{}".format(capability)
    last = next((version for below, version in REMOVED if capability < below), None)
    if capability < OLDEST_KEPT:
        text = "CUDA {} and newer have no code for {}, which the build requests".format(last, name)
        way = "Leave it out of TORCH_CUDA_ARCH_LIST (or of the flags in setup.py), or use an older CUDA toolkit."
        return Cause("cuda-toolkit", text, {"text": way})
    first = next((version for least, version in BROUGHT if capability >= least), None)
    if first is None:
        return None
    text = "code for {} is made by CUDA {} and newer, and this nvcc is older".format(name, first)
    way = "Install CUDA {} or newer, or leave {} out of TORCH_CUDA_ARCH_LIST.".format(first, name)
    return Cause("cuda-toolkit", text, {"text": way})


def _key(text: str) -> Any:
    try:
        return parsed(text)
    except ValueError:
        return parsed("0")


def _symbol(line: str, scene: Scene) -> Optional[Cause]:
    if not TORCH_SYMBOL.search(line):
        return None
    names: List[str] = [name for name in scene.modules if name != "torch"]
    built = re.search(r"[/\\]([\w.+-]+?)\.(?:cpython|abi3|so)\S*: undefined symbol", line)
    subject = names[0] if names else built.group(1) if built else "torch"
    text = "`{}` was compiled for another release of torch than the one that is installed".format(subject)
    return Cause(
        subject, text, {"text": "Build it again in this environment, or install the torch that it was built for."}
    )
