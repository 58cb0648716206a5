"""Makes the synthetic coupon tests of configs/fits: `python tests/synthetic_coupons.py`."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np

from dealib.materials import coupon
from dealib.materials.laws import LAWS

FITS = Path(__file__).parent.parent / "configs" / "fits"
SEED = 2012

SILICONE = coupon.IncompressibleMaterial(
    LAWS["gent"], SimpleNamespace(shear_modulus=0.25, j_lim=14.0, bulk_modulus=0.0)
)
ACRYLIC = coupon.IncompressibleMaterial(
    LAWS["neo_hookean"], SimpleNamespace(shear_modulus=0.015, bulk_modulus=0.0), "network",
    ((0.025, 2.0), (0.012, 40.0)),
)  # fmt: skip
FILLED = coupon.IncompressibleMaterial(
    LAWS["yeoh"], SimpleNamespace(c10=0.2, c20=-0.015, c30=0.004, bulk_modulus=0.0),
    mullins=SimpleNamespace(r=1.8, m=0.12),
    set=SimpleNamespace(shear_modulus=0.08, energy=0.2),
)  # fmt: skip


def stress(material, mode, time, stretch, at):
    """Stretches and nominal stresses, MPa, at times along a polyline of stretches."""
    t, l, _ = coupon.refined(time, stretch, coupon.FINE)
    fine = np.interp(np.linspace(0, len(t) - 1, 4 * len(t) - 3), np.arange(len(t)), t)
    path = coupon.Path(mode, fine, np.interp(fine, t, l))
    (P,) = coupon.stresses(path, [material])
    return np.interp(at, fine, path.stretch), np.interp(at, fine, P)


def csv(label, header, x, y, digits):
    rows = "".join(
        f"{a:.{digits[0]}f},{b:.{digits[1]}f}\n" for a, b in zip(x, y, strict=True)
    )  # fmt: skip
    return "".join(f"# {line}\n" for line in label) + header + "\n" + rows


def texts():
    """Content of the files by name."""
    random = np.random.default_rng(SEED)
    made = "SYNTHETIC, no measurement: made by tests/synthetic_coupons.py, "
    found = {}
    what = made + "Gent, G 250 kPa, J_lim 14,"
    for name, mode, largest in (
        ("uniaxial", "uniaxial", 3.5), ("shear", "pure shear", 3.0),
        ("biaxial", "equal-biaxial", 2.4),
    ):  # fmt: skip
        t = np.linspace(0, 1, 40)
        l, P = stress(SILICONE, mode, [0, 1], [1, largest], t)
        noise = random.normal(0, 0.003, len(t)), random.normal(0, 0.005, len(t))
        if name == "uniaxial":  # 20 x 4 x 0.5 mm: 2 mm2
            label = (what, "noise 0.06 mm and 10 mN; strip of 20 x 4 x 0.5 mm")
            x, y = 20 * (l - 1 + noise[0]), 2e3 * (P + noise[1])
            text = csv(label, "elongation [mm],force [mN]", x, y, (3, 1))
        else:
            label = (what, "noise 0.003 of the stretch and 5 kPa")
            text = csv(label, "stretch,stress [kPa]", l + noise[0], 1e3 * (P + noise[1]), (4, 2))
        found[f"synthetic_{name}.csv"] = text
    what = made + "neo-Hookean, G 15 kPa, with branches of 25 kPa, 2 s and 12 kPa, 40 s,"
    for rate in ("0.01", "0.1", "1"):
        end = 2 / float(rate)
        t = np.linspace(0, end, 60)
        l, P = stress(ACRYLIC, "uniaxial", [0, end / 2, end], [1, 2, 1], t)
        x, y = l + random.normal(0, 0.003, 60), 1e3 * P + random.normal(0, 0.3, 60)
        label = (what, f"at {rate} 1/s, noise 0.003 of the stretch and 0.3 kPa")
        found[f"synthetic_rate_{rate}.csv"] = csv(label, "stretch,stress [kPa]", x, y, (4, 3))
    t = np.geomspace(0.5, 300, 50)
    _, P = stress(ACRYLIC, "uniaxial", [0, 0.5, 300], [1, 2, 2], t)
    label = (what, "stretched by 2 in 0.5 s, noise 0.3 kPa")
    y = 1e3 * P + random.normal(0, 0.3, 50)
    found["synthetic_held.csv"] = csv(label, "time [s],stress [kPa]", t, y, (4, 3))
    what = made + "Yeoh, c10 200, c20 -15, c30 4 kPa,"
    t = np.linspace(0, 8, 240)
    l, P = stress(FILLED, "uniaxial", np.arange(9.0), [1, 1.5, 1, 2, 1, 2.5, 1, 2.5, 1], t)
    l, P = l[P > 0], P[P > 0]  # a strip bears no pressure
    more = "Mullins r 1.8, m 120 kPa; permanent set 80 kPa, 200 kPa; noise 0.002 and 3 kPa"
    x, y = l + random.normal(0, 0.002, len(l)), 1e3 * P + random.normal(0, 3, len(l))
    label = (what, more)
    found["synthetic_cycles.csv"] = csv(label, "stretch,stress [kPa]", x, y, (4, 2))
    return found


if __name__ == "__main__":
    for name, text in texts().items():
        (FITS / name).write_text(text)
