"""Every test runs in double precision, with compiled code kept between runs (`PDSSJAX_CACHE` says where)."""

from stand_ins import calls as calls

from pdssjax.core import prepare_jax

prepare_jax()
