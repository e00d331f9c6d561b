"""Every test runs in double precision, with compiled code kept between runs (`PDSSJAX_CACHE` says where).

Most of the tests' time goes into compiling, so they compile without LLVM's expensive passes.
"""

import os

from stand_ins import calls as calls

from pdssjax.core import prepare_jax

# XLA reads this when the first computation is asked for.
os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} --xla_llvm_disable_expensive_passes=true".strip()

prepare_jax()
