"""Strict settings for every test: types and shapes checked, no promotion, float64."""

import gc
import os
from pathlib import Path

import jax
import pytest
from jaxtyping import install_import_hook

install_import_hook("wheelhop", "beartype.beartype")

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")
# one cache per worker: a file that another worker is still writing must not be read
CACHE = Path(os.environ.get("WHEELHOP_CACHE", "/tmp/wheelhop"))
WORKER = os.environ.get("PYTEST_XDIST_WORKER", "main")
jax.config.update("jax_compilation_cache_dir", str(CACHE / WORKER))
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)

REPOSITORY = Path(__file__).resolve().parents[1]
DATA = Path(os.environ.get("WHEELHOP_DATA", REPOSITORY.parent / "shared" / "data"))


@pytest.fixture(scope="session")
def data() -> Path:
    """The measured roads and tyres, which the package does not ship."""
    if not DATA.is_dir():
        pytest.skip(f"no measured data at {DATA}; set WHEELHOP_DATA")
    return DATA


@pytest.fixture(autouse=True, scope="module")
def _release_compiled_code():
    """Compiled functions stay mapped in memory; a whole suite of them exceeds what Linux maps."""
    yield
    maps = Path("/proc/self/maps")
    if not maps.exists() or len(maps.read_text().splitlines()) > 20_000:
        jax.clear_caches()
        gc.collect()


@pytest.fixture
def float32():
    """Run a test in JAX's default precision."""
    with jax.enable_x64(False):
        yield
