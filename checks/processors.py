"""Environments in which libraries compute as on older processors; `python -m checks.processors haswell COMMAND …` runs a command in one."""

import os
import sys

from numpy._core import _multiarray_umath as numpy_core

AVX512 = "-AVX512F,-AVX512VL,-AVX512BW,-AVX512DQ"
PROFILES = {
    "haswell": {  # AVX2 and FMA, no AVX-512
        "ATEN_CPU_CAPABILITY": "avx2",
        "DNNL_MAX_CPU_ISA": "AVX2",
        "GLIBC_TUNABLES": f"glibc.cpu.hwcaps={AVX512}",
        "MKL_CBWR": "AVX2",
        "NUMBA_CPU_NAME": "haswell",
        "OPENBLAS_CORETYPE": "Haswell",
    },
    "prescott": {  # SSE4.2 in numpy and numba, their minimum, SSE3 in OpenBLAS
        "ATEN_CPU_CAPABILITY": "default",
        "DNNL_MAX_CPU_ISA": "SSE41",
        "GLIBC_TUNABLES": f"glibc.cpu.hwcaps={AVX512},-AVX2,-AVX,-FMA,-FMA4",
        "LP_NATIVE_VECTOR_WIDTH": "128",
        "MKL_CBWR": "COMPATIBLE",
        "NUMBA_CPU_NAME": "nehalem",
        "OPENBLAS_CORETYPE": "Prescott",
    },
}


def environment(profile: str) -> dict[str, str]:
    """Return the variables of a profile, which also disable the features of numpy that the imitated processor lacks.

    numpy warns of a name that is not among its own or that the processor has not, and the tests take warnings as errors.
    """
    kept = ["X86_V3"] if profile == "haswell" else []
    disabled = [name for name in numpy_core.__cpu_dispatch__ if numpy_core.__cpu_features__[name] and name not in kept]
    return {**PROFILES[profile], "NPY_DISABLE_CPU_FEATURES": " ".join(disabled)}


if __name__ == "__main__":
    profile, *command = sys.argv[1:]
    os.execvpe(command[0], command, {**os.environ, **environment(profile)})
