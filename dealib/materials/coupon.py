"""Homogeneous tests of an incompressible material: its stress along a path of stretches in time.

The second stretch in the plane is a power of the first, which is driven. Stresses are nominal, MPa.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from dealib.arrays import Array
from dealib.materials.evolution import EVOLUTIONS, Evolution, Network, inverted, weights
from dealib.materials.law import Law, invariants_of_stretches
from dealib.materials.softening import Mullins, PermanentSet, softening

# exponent of the second stretch, and number of directions that are loaded
MODES = {"uniaxial": (-0.5, 1), "equal-biaxial": (1.0, 2), "pure shear": (0.0, 1)}
STEP = 0.02  # of the logarithmic stretch
FINE = 0.005  # the same where softening gives the stress kinks
_RAMP, _HOLD = 8, 60  # fewest steps of a ramp; steps of a hold


@dataclass(frozen=True)
class Path:
    """The course of a test.

    Attributes:
        mode: A key of `MODES`.
        time: Times, s, ascending, (states,); infinite ones mean equilibrium.
        stretch: Stretch in the loaded direction, (states,).
        known: Stresses of branches of unit modulus that were computed before, by the name of
            their evolution and their relaxation time.
    """

    mode: str
    time: Array
    stretch: Array
    known: dict[tuple[str, float], Array] = field(default_factory=dict, repr=False, compare=False)

    @property
    def metric(self) -> Array:
        """Packed C = F^T F, (states, 4)."""
        second = self.stretch ** MODES[self.mode][0]
        zero = np.zeros_like(second)
        return np.stack([self.stretch, second, 1 / (self.stretch * second), zero], axis=-1) ** 2


def refined(
    time: Sequence[float], stretch: Sequence[float], step: float = STEP
) -> tuple[Array, Array, npt.NDArray[np.intp]]:
    """Steps along straight pieces: even ones in ramps, growing ones in holds.

    Args:
        time: Times of the corners; infinite ones mean equilibrium.
        stretch: Stretches there.
        step: Largest step of the logarithmic stretch.

    Returns:
        Times and stretches, (states,), and which states are the corners.
    """
    times, stretches = [np.asarray(time[:1], dtype=float)], [np.asarray(stretch[:1], dtype=float)]
    many, corners = len(time) > 50, [0]
    for t0, t1, l0, l1 in zip(time, time[1:], stretch, stretch[1:], strict=False):
        strain = abs(np.log(l1 / l0))
        if strain < 1e-3 and not many:
            share = np.expm1(np.linspace(0, 7, _HOLD + 1)[1:]) / np.expm1(7)
        else:
            n = max(1 if many else _RAMP, int(np.ceil(strain / step)))
            share = np.arange(1, n + 1) / n
        times.append(t0 + share * (t1 - t0) if t1 < np.inf else np.full(len(share), np.inf))
        stretches.append(l0 + share * (l1 - l0))
        corners.append(corners[-1] + len(share))
    return np.concatenate(times), np.concatenate(stretches), np.array(corners)


def energy(law: type[Law], p: Any, mode: str, stretch: Array) -> tuple[Array, Array]:
    """Energy density of a law and its nominal stress, at constant volume.

    Args:
        law: The law.
        p: Its parameters, as `Law.energy` takes them.
        mode: A key of `MODES`.
        stretch: Stretch in the loaded direction, any shape.

    Returns:
        Both in MPa, of the stretch's shape.
    """
    exponent, loaded = MODES[mode]
    l = stretch + 1e-30j  # complex step, exact to rounding
    second = l**exponent
    W = law.isochoric_energy(invariants_of_stretches(l, second, 1 / (l * second)), p)
    return np.real(W), np.imag(W) / 1e-30 / loaded


def network(path: Path, evolution: Evolution, ratios: Array) -> Array:
    """Nominal stress of a branch of unit shear modulus that is relaxed at the start.

    Args:
        path: The test.
        evolution: Evolution of its internal metric.
        ratios: Steps of its clock over its relaxation time, (states - 1, branches).

    Returns:
        (branches, states).
    """
    C, inner = path.metric[:, None], np.empty((len(path.time), ratios.shape[1], 4))
    inner[0] = C[0]
    if isinstance(evolution, Network):  # linear: C_i^-1 = decay C_i^-1 + load
        back = inverted(C)
        decay, old, new = (w[..., None] for w in weights(ratios))
        load, inner[0] = old * back[:-1] + new * back[1:], back[0]
        for n in range(len(ratios)):
            inner[n + 1] = decay[n] * inner[n] + load[n]
    else:
        C = np.broadcast_to(C, inner.shape)
        for n, ratio in enumerate(ratios):
            inner[n + 1] = evolution.end(*evolution.step(C[n], inner[n], ratio), C[n + 1])
        inner = inverted(inner)
    exponent, loaded = MODES[path.mode]
    powers = np.array([1.0, exponent, -1 - exponent])  # of the driven stretch
    changes = powers * path.metric[:, :3] / path.stretch[:, None]  # half of dC/dl
    stress = (changes[:, None] * inner[..., :3]).sum(-1) / loaded
    return np.asarray(stress.T)


@dataclass(frozen=True)
class IncompressibleMaterial:
    """An incompressible material.

    Attributes:
        law: Its law.
        p: The law's parameters, MPa.
        evolution: Name of the branches' evolution.
        branches: Shear modulus and relaxation time of each.
        mullins: Its softening.
        set: Its permanent set.
    """

    law: type[Law]
    p: Any
    evolution: str = "multiplicative"
    branches: tuple[tuple[float, float], ...] = ()
    mullins: Mullins | None = None
    set: PermanentSet | None = None


def networks(path: Path, evolution: str, times: Sequence[float]) -> dict[float, Array]:
    """Nominal stress, (states,), of Maxwell branches of unit modulus by their relaxation times."""
    new = [time for time in times if (evolution, time) not in path.known]
    if new:
        with np.errstate(all="ignore"):
            steps = np.diff(path.time)
            steps[np.isnan(steps)] = np.inf
            found = network(path, EVOLUTIONS[evolution], steps[:, None] / np.array(new))
        path.known.update(((evolution, time), P) for time, P in zip(new, found, strict=True))
    return {time: path.known[evolution, time] for time in times}


def stresses(path: Path, materials: Sequence[IncompressibleMaterial]) -> list[Array]:
    """Nominal stress of several materials in one test, (states,) each; NaN where a law locks."""
    times = sorted({time for m in materials for _, time in m.branches})
    units = networks(path, materials[0].evolution, times)
    with np.errstate(all="ignore"):
        elastic = [energy(m.law, m.p, path.mode, path.stretch) for m in materials]
    peaks = [np.maximum.accumulate(W) for W, _ in elastic]
    sets = [(i, m.set) for i, m in enumerate(materials) if m.set is not None]
    second: dict[int, Array] = {}
    if sets:
        clocks = np.stack([np.diff(peaks[i]) / given.energy for i, given in sets], axis=1)
        with np.errstate(all="ignore"):
            found = network(path, EVOLUTIONS["network"], clocks)
        second = {i: given.shear_modulus * P for (i, given), P in zip(sets, found, strict=True)}
    out = []
    for i, (m, (W, P)) in enumerate(zip(materials, elastic, strict=True)):
        if m.mullins is not None:
            P = P * softening(W, peaks[i], m.mullins)
        branches = sum((G * units[time] for G, time in m.branches), np.zeros(len(P)))
        out.append(P + branches + second.get(i, 0.0))
    return out
