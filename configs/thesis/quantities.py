"""The quantities behind the thesis's windows."""

from __future__ import annotations

from devices import MASSES, VOLTS, Device, Parameters, Solver, Solvers, Target

from dealib.units import EPSILON_0, GRAVITY


def quantities(p: Parameters, solvers: Solvers) -> dict[str, float]:
    """Every quantity that a window asks for.

    Those of Figs. 31 and 32 by both couplings: with `_undeformed` by `pelrine_undeformed`.
    """
    solve = solvers["energy"]
    q: dict[str, float] = {
        "outer_75": p.outer_75,
        "outer_100": p.outer_100,
        "outer_200": p.outer_200,
        "length_100": p.outer_100 - p.inner_100,
        "length_200": p.outer_200 - p.inner_200,
        "film_um": 1e3 * p.film_thickness,
        "permittivity": p.permittivity,
        "preload23_N": p.preload_23,
    }
    q |= _film_alone(p, solve)
    charges, stresses = {}, {}
    for size, law in ((100, "nh"), (100, "mr"), (75, "nh"), (75, "mr"), (200, "nh")):
        tag = law if size == 100 else f"{law}{size}"
        path = [Target(u=0.001), Target(u=1), Target(u=2), Target(u=2, V=VOLTS), Target(u=2)]
        path += [Target(u=2.5), Target(u=3)]
        if tag == "nh75":
            path += [Target(u=p.displacement_35), Target(u=p.displacement_35, V=VOLTS)]
        rest, _, held, driven, _, more, last, *other = solve(Device.of(p, size, law), path)
        q[f"{tag}_F2"], q[f"{tag}_F3"] = held.F, last.F
        q[f"{tag}_blocking"] = held.F - driven.F
        if other:
            q[f"{tag}_blocking_35"] = other[0].F - other[1].F
        if law == "nh":
            q[f"C{size}_0"], q[f"C{size}_25"] = rest.C, more.C
            q[f"charge_{size}"] = charges[size] = driven.charge_density
            stresses[size] = held.radial_stress
        if tag == "nh":
            q["stress_ratio"] = held.electrode_stress / held.radial_stress
    for mm in (2, 3):
        q[f"ratio_{mm}"] = q[f"mr_F{mm}"] / q[f"nh_F{mm}"]
        q[f"ratio_75_{mm}"] = q[f"mr75_F{mm}"] / q[f"nh75_F{mm}"]
    q["charge_spread"] = max(charges.values()) / min(charges.values()) - 1
    q["field"] = charges[100] / (EPSILON_0 * p.permittivity)
    q["S_100_75"], q["S_200_100"] = stresses[100] / stresses[75], stresses[200] / stresses[100]
    for law in ("nh", "mr"):
        device = Device.of(p, law=law)
        q |= {f"{law}_{name}": s for name, s in strokes(device, solve).items()}
        by_rest = solvers["pelrine_undeformed"]
        q |= {f"{law}_{name}_undeformed": s for name, s in strokes(device, by_rest).items()}
        held, driven = by_rest(device, [Target(u=2), Target(u=2, V=VOLTS)])
        q[f"{law}_blocking_undeformed"] = held.F - driven.F
    for um in (10, 20):
        device = Device.of(p, electrode_thickness=um / 1000)
        q[f"preload36_u{um}"] = solve(device, [Target(F=p.preload_36)])[-1].u
    q["preload12_u"] = solve(Device.of(p), [Target(F=p.preload_12)])[-1].u
    actuated = [Target(F=p.preload_23), Target(F=p.preload_23, V=VOLTS)]
    q["preload23_u"] = solve(Device.of(p), actuated)[-1].u
    return q


def _film_alone(p: Parameters, solve: Solver) -> dict[str, float]:
    """Fig. 19; the force of a film alone is in proportion to its modulus."""
    push = [Target(u=1.0), Target(u=2.0), Target(u=3.0)]
    nh, mr = (
        [s.F for s in solve(Device.of(p, law=law, electrode_thickness=0.0), push)]
        for law in ("nh", "mr")
    )
    q = {"film_nh1_F3": nh[2], "film_nh15_F3": 1.5 * nh[2], "film_mr15_F3": 1.5 / 1.25 * mr[2]}
    return q | {f"film_ratio_{mm}": mr[mm - 1] / nh[mm - 1] for mm in (1, 2, 3)}


def strokes(device: Device, solve: Solver) -> dict[str, float]:
    """Fig. 31: the strokes in mm by mass, and each over the one before."""
    path = [Target(F=1e-3 * m * GRAVITY, V=V) for m in MASSES for V in (0.0, VOLTS, 0.0)]
    states = solve(device, path)
    found = [states[k + 1].u - states[k].u for k in range(0, len(states), 3)]
    q = {f"stroke_{m:g}": s for m, s in zip(MASSES, found, strict=True)}
    for k in range(1, len(MASSES)):
        q[f"stroke_{MASSES[k]:g}_{MASSES[k - 1]:g}"] = found[k] / found[k - 1]
    q["stroke_28_5"] = found[-1] / found[0]
    return q
