"""Many vehicles at once, in lanes: the fast way to a Monte Carlo of drives.

`fleet_simulator` gives what `jax.vmap(simulate_vehicle)` gives. It lays the vehicles along the
trailing axis of every entry, where they fill the SIMD lanes, in chunks that fit the cache, and
shares the chunks among the devices.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.errors import DivergenceError, InputError
from wheelhop.staging import staged_jit
from wheelhop.vehicle.simulation import RATE, SUBSTEPS, Signals, simulate_vehicle

LANES = 128
"""Vehicles per chunk."""

ARGUMENTS = ("initial", "vehicle", "maneuver", "road", "pressure", "around")
"""What a fleet is called with, in this order."""

Axes = tuple[Any, Any, Any, Any, Any, Any]


def keep_all(signals: Signals) -> Signals:
    """Every signal."""
    return signals


def fleet_simulator(
    samples: int,
    rate: float = RATE,
    substeps: int = SUBSTEPS,
    *,
    in_axes: Axes = (0, None, None, None, None, None),
    keep: Callable[[Signals], Any] = keep_all,
    lanes: int = LANES,
    devices: Sequence[Any] | None = None,
    check: bool = True,
) -> Callable[..., Any]:
    """A compiled drive of many vehicles.

    Args:
        samples: length of each record.
        rate: samples per second [Hz].
        substeps: Runge-Kutta steps per sample.
        in_axes: which of `ARGUMENTS` lead with a run axis, as in `jax.vmap`: each 0, None or,
            for parts of it, a tree of these. A road has it whole or not at all.
        keep: chooses what to store of the signals, entries [time, ..., lanes].
        lanes: vehicles per chunk.
        devices: that share the chunks; the first alone by default.
        check: wait for the result and refuse one with a run whose last state, or what is kept of
            it, is not finite; otherwise such numbers are returned.

    Returns:
        A function of `ARGUMENTS`, all leaves arrays of one floating type; it returns what `keep`
        chose, leaves [runs, time, ...].

    Raises:
        InputError: for lanes that are not positive, or (when called) run axes that differ.
        DivergenceError: (when called) naming the first run that left the finite numbers.
    """
    if lanes < 1:
        raise InputError("lanes", f"{lanes} vehicles per chunk", "Give at least 1.")
    places = tuple(jax.devices()[:1]) if devices is None else tuple(devices)

    def chunk(arguments: Any) -> Any:
        initial, vehicle, maneuver, road, pressure, around = (
            _in_lanes(tree, axes, name)
            for tree, axes, name in zip(arguments, in_axes, ARGUMENTS, strict=True)
        )
        last, signals = simulate_vehicle(
            initial, vehicle, maneuver, road, pressure, around, samples, rate, substeps
        )
        kept = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, -1, 0), keep(signals))
        ends = [jnp.moveaxis(leaf, -1, 0) for leaf in last]
        return kept, _finite([*ends, *jax.tree.leaves(kept)]) if check else ()

    def one_device(varying: list[Any], shared: list[Any], structure: Any, mask: Any) -> Any:
        def run(part: list[Any]) -> Any:
            both = iter(part), iter(shared)
            leaves = [next(both[0] if varies else both[1]) for varies in mask]
            return chunk(jax.tree.unflatten(structure, leaves))

        return jax.lax.map(run, varying)

    compiled: dict[Any, Any] = {}

    def call(*arguments: Any) -> Any:
        leaves, structure = jax.tree.flatten(arguments)
        mask = tuple(
            varies
            for tree, axes in zip(arguments, in_axes, strict=True)
            for varies in _varies(tree, axes)
        )
        runs = _runs(leaves, mask)
        width = min(lanes, -(-runs // len(places)))
        chunks = -(-runs // (width * len(places))) * len(places)
        both = list(zip(leaves, mask, strict=True))
        varying = [_chunked(leaf, chunks, width) for leaf, varies in both if varies]
        shared = [leaf for leaf, varies in both if not varies]
        if (structure, mask) not in compiled:
            compiled[structure, mask] = _compile(
                lambda v, s: one_device(v, s, structure, mask), places
            )
        found, finite = jax.tree.map(
            lambda leaf: _on_one(leaf, places).reshape((-1, *leaf.shape[2:]))[:runs],
            compiled[structure, mask](varying, shared),
        )
        if check:
            _raise_if_diverged(np.asarray(finite))
        return found

    return call


def _on_one(leaf: Any, places: tuple[Any, ...]) -> Any:
    """The array on the first device, by way of the host.

    To reshape it where it lies is a collective of the devices for every leaf, and those of several
    leaves in flight can wait for each other for ever.
    """
    return leaf if len(places) == 1 else jax.device_put(np.asarray(leaf), places[0])


def _finite(leaves: list[Any]) -> Any:
    """Of every run, whether all its numbers are finite; leaves [runs, ...]."""
    rows = [leaf.reshape((leaf.shape[0], -1)) for leaf in leaves]
    return jnp.stack([jnp.isfinite(row).all(-1) for row in rows]).all(0)


def _raise_if_diverged(finite: np.ndarray) -> None:
    bad = np.flatnonzero(~finite)
    if bad.size:
        raise DivergenceError(
            f"{bad.size} of {finite.size} runs left the finite numbers, the first is run "
            f"{bad[0]}: look at its vehicle, road and maneuver, or take shorter steps (substeps)"
        )


def _compile(function: Callable[..., Any], devices: tuple[Any, ...]) -> Callable[..., Any]:
    if len(devices) == 1:
        return staged_jit(function)
    mesh = jax.sharding.Mesh(np.asarray(devices), ("chunks",))
    split, whole = jax.sharding.PartitionSpec("chunks"), jax.sharding.PartitionSpec()
    return staged_jit(
        jax.shard_map(
            function, mesh=mesh, in_specs=(split, whole), out_specs=split, check_vma=False
        )
    )


def _in_lanes(tree: Any, axes: Any, name: str) -> Any:
    """Run axes to the end; what is shared gets an axis of one there, but for a shared road."""
    if name == "road" and axes is None:
        return tree
    leaves, structure = jax.tree.flatten(tree)
    moved = [
        jnp.moveaxis(leaf, 0, -1) if varies else leaf[..., None]
        for leaf, varies in zip(leaves, _varies(tree, axes), strict=True)
    ]
    return jax.tree.unflatten(structure, moved)


def _varies(tree: Any, axes: Any) -> list[bool]:
    """For every leaf, whether it leads with a run axis."""
    if axes is None or axes == 0:
        return [axes == 0] * len(jax.tree.leaves(tree))
    parts = jax.tree.map(
        lambda axis, part: [axis == 0] * len(jax.tree.leaves(part)),
        axes,
        tree,
        is_leaf=lambda axis: axis is None,
    )
    return jax.tree.leaves(parts)


def _runs(leaves: list[Any], mask: tuple[bool, ...]) -> int:
    varying = [jnp.shape(leaf) for leaf, varies in zip(leaves, mask, strict=True) if varies]
    counts = {shape[0] if shape else 0 for shape in varying}
    if len(counts) != 1:
        raise InputError(
            "in_axes",
            f"the run axes have the lengths {sorted(counts)} (0: a number without an axis)",
            "Give all of them one length, and at least one of them.",
        )
    return int(counts.pop())


def _chunked(leaf: Any, chunks: int, width: int) -> Any:
    """[runs, ...] -> [chunks, width, ...], the last run repeated to fill the last chunk."""
    index = np.minimum(np.arange(chunks * width), leaf.shape[0] - 1)
    return jnp.asarray(leaf)[index].reshape((chunks, width, *leaf.shape[1:]))
