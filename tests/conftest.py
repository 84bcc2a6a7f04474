"""Strict settings for every test: types and shapes checked, no promotion, float64."""

import gc
import os
from contextlib import contextmanager
from pathlib import Path

import jax
import pytest
from jaxtyping import install_import_hook

install_import_hook("wheelhop", "beartype.beartype")

# What a test compiles it runs once: a quarter of the compiling, for slower code. XLA aborts on a
# flag it does not know, so only where both are known; an empty XLA_FLAGS compiles as users do.
AS_USERS = {"xla_backend_optimization_level": 3, "xla_cpu_use_fusion_emitters": True}
if jax.__version_info__ < (0, 11):
    QUICK = "--xla_backend_optimization_level=0 --xla_cpu_use_fusion_emitters=false"
    os.environ.setdefault("XLA_FLAGS", QUICK)

jax.config.update("jax_enable_x64", True)
# two batched decompositions in flight at once can wait for ever for each other's threads, seen
# with two processors (jaxlib 0.10.2)
jax.config.update("jax_cpu_enable_async_dispatch", False)
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


@pytest.fixture(scope="session")
def stages_as_users_compile(as_users_compile):
    """Context in which `staged_jit` compiles with XLA's defaults, and the options `jit` needs."""
    from wheelhop import staging

    def forget():
        staging.available.cache_clear()
        staging.misfits.cache_clear()

    @contextmanager
    def context():
        options = as_users_compile
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(staging, "_OPTIONS", staging._OPTIONS | options)
            forget()
            yield options
        forget()

    return context


@pytest.fixture(scope="session")
def as_users_compile():
    """Options with which `jax.jit` compiles as for a user, where rounding is under test."""
    return AS_USERS if os.environ.get("XLA_FLAGS") else {}


@pytest.fixture
def float32():
    """Run a test in JAX's default precision."""
    with jax.enable_x64(False):
        yield
