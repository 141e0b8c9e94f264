"""Curves of indentation tests made from known laws: it shares no code with the package."""

from dataclasses import dataclass, field

import numpy as np


@dataclass
class Made:
    """A test to be made; SI throughout, one entry of each list for each indentation."""

    loading: list  # N/m, slope of the nearest line between 20 and 100 % of the peak
    unloading: list
    loading_exponent: float = 1.0
    unloading_exponent: float = 1.0
    peak: float = 3000.0
    rate: float = 10.0  # Hz
    speed: float = 0.1e-3 / 60.0  # m/s
    gap: float = 30e-6  # m between indenter and rock before and after
    standing: float = 20.0  # s before the approach and after the retreat
    hold: float = 0.0  # s
    creep: float = 0.0  # m, at constant force
    relaxation: float = 0.0  # share of the force lost at constant displacement instead
    compliance: float = 0.0  # m/N
    zero: float = 0.0  # N
    force_drift: float = 0.0  # N/s
    displacement_drift: float = 0.0  # m/s
    force_noise: tuple = (3.0, 0.0, 0.0)  # N: white, autocorrelated, correlation from sample to sample
    displacement_noise: tuple = (0.1e-6, 0.0, 0.0)  # m
    quantum: float = 0.0  # m, of the displacement
    hum: float = 0.0  # N
    mains: float = 50.1  # Hz
    origins: list = field(default_factory=list)  # filled in: first contact and residual depth of each

    @property
    def depths(self):
        """From origin to peak, of loading and unloading of each indentation."""
        pairs = zip(self.loading, self.unloading, strict=True)
        return [
            tuple(
                self.peak * line(n) / k
                for k, n in zip(each, (self.loading_exponent, self.unloading_exponent), strict=True)
            )
            for each in pairs
        ]

    def make(self, rng):
        """Time, displacement and force as recorded, and the number of the indentation."""
        time, depth, force, number = self._true()
        displacement = depth + self.compliance * force + self.displacement_drift * time
        displacement = displacement + coloured(rng, time.size, self.displacement_noise)
        if self.quantum:
            displacement = self.quantum * np.round(displacement / self.quantum)
        force = force + self.zero + self.force_drift * time + coloured(rng, time.size, self.force_noise)
        force += self.hum * np.sin(2 * np.pi * self.mains * time)
        return time, displacement, force, number

    def _true(self):
        step = self.speed / self.rate
        depths, forces, numbers = [], [], []
        surface = 50e-6
        self.origins = []
        standing = np.full(int(self.standing * self.rate), surface - self.gap)
        for j, (down, up) in enumerate(self.depths):
            deepest = surface + down
            approach = np.arange(surface - self.gap, deepest, step)
            held = deepest + self.creep * (1 - np.exp(-np.linspace(0, 5, int(self.hold * self.rate)))) / (
                1 - np.exp(-5)
            )
            deepest = deepest + (self.creep if self.hold else 0.0)
            left = 1.0 - (self.relaxation if self.hold else 0.0)
            relaxed = 1 - (1 - left) * (1 - np.exp(-np.linspace(0, 5, held.size))) / (1 - np.exp(-5))
            residual = deepest - up * left ** (1 / self.unloading_exponent)
            retreat = np.arange(deepest, residual - self.gap, -step)
            loading = self.peak * (np.maximum(approach - surface, 0) / down) ** self.loading_exponent
            unloading = self.peak * (np.maximum(retreat - residual, 0) / up) ** self.unloading_exponent
            self.origins.append((surface, residual))
            depths += [approach, held, retreat]
            forces += [loading, self.peak * relaxed, unloading]
            numbers.append(np.full(approach.size + held.size + retreat.size, j + 1.0))
            surface = residual
        end = np.full(standing.size, depths[-1][-1])
        depth = np.concatenate([standing, *depths, end])
        force = np.concatenate([np.zeros(standing.size), *forces, np.zeros(end.size)])
        ends = (np.full(standing.size, 1.0), np.full(end.size, float(len(self.loading))))
        return np.arange(depth.size) / self.rate, depth, force, np.concatenate([ends[0], *numbers, ends[1]])

    def coefficient(self, j, way):
        """k of the power law in N/m^n; way 0 is loading."""
        n = (self.loading_exponent, self.unloading_exponent)[way]
        return self.peak / self.depths[j][way] ** n

    def truth(self, j):
        """By symbol, of one indentation."""
        return {
            "k_l": self.loading[j],
            "k_u": self.unloading[j],
            "n_l": self.loading_exponent,
            "n_u": self.unloading_exponent,
        }


def line(exponent):
    """Slope of the straight line nearest to u^n where u^n is 0.2 to 1, by brute force."""
    u = np.linspace(0.2 ** (1 / exponent), 1.0, 20001)
    return np.polyfit(u, u**exponent, 1)[0]


def coloured(rng, n, noise):
    """White noise and noise with a memory."""
    white, slow, memory = noise
    values = rng.normal(0.0, 1.0, n)
    remembered = np.empty(n)
    last = rng.normal()
    for i, innovation in enumerate(values * np.sqrt(1 - memory**2)):
        last = memory * last + innovation
        remembered[i] = last
    return white * rng.normal(0.0, 1.0, n) + slow * remembered


def drawn(rng, most=10, exponents=(0.85, 1.6)):
    """A test drawn at random within the range of Table 2.2, with noise of several kinds."""
    count = int(rng.integers(1, most + 1))
    k_l = rng.uniform(11e6, 33e6)
    k_u = k_l * rng.uniform(1.08, 1.4)
    scatter = rng.choice([0.0, 0.02])
    kind = rng.choice(["white", "memory", "both", "coarse"])
    n = rng.uniform(*exponents, 2) if rng.random() < 0.7 else np.ones(2)
    memory = rng.uniform(0.5, 0.95)
    size = rng.uniform(0.3, 1.0)
    held = rng.random() < 0.5
    noisy = {
        "white": {"force_noise": (10 * size, 0, 0), "displacement_noise": (0.3e-6 * size, 0, 0)},
        "memory": {"force_noise": (2 * size, 8 * size, memory), "displacement_noise": (0.05e-6, 0.3e-6 * size, memory)},
        "both": {"force_noise": (10 * size, 0, 0), "displacement_noise": (0.1e-6, 0.3e-6 * size, memory)},
        "coarse": {
            "force_noise": (10 * size, 0, 0),
            "displacement_noise": (0.1e-6, 0, 0),
            "quantum": 0.5e-6,
            "hum": 5.0,
        },
    }[str(kind)]
    loading = k_l * (1 + scatter * rng.standard_normal(count))
    loading[0] *= rng.choice([1.0, 0.5, 0.2])  # the first is an impact, as soft as in Table 2.2
    return Made(
        list(loading),
        list(k_u * (1 + scatter * rng.standard_normal(count))),
        *(float(each) for each in n),
        peak=rng.uniform(1500, 4000),
        rate=float(rng.choice([3.0, 10.0, 20.0])),
        gap=rng.uniform(25e-6, 50e-6),
        hold=30.0 if held else 0.0,
        creep=rng.uniform(1e-6, 8e-6) if held else 0.0,
        compliance=float(rng.choice([0.0, 5e-9, 1.5e-8])),
        zero=rng.uniform(-50, 50),
        force_drift=rng.uniform(-0.02, 0.02),
        displacement_drift=rng.uniform(-2e-8, 2e-8),
        mains=rng.uniform(49.5, 50.5),
        **noisy,
    )


def write(
    path, time, displacement, force, header="time (s),displacement (mm),force (kN)", delimiter=",", scale=(1e3, 1e-3)
):
    """The curve as a csv; a semicolon brings decimal commas."""
    rows = np.column_stack([time, scale[0] * displacement, scale[1] * force])
    lines = [delimiter.join(f"{value:.9g}" for value in row) for row in rows]
    text = "\n".join([header, *lines]) + "\n"
    path.write_text(text.replace(".", ",") if delimiter == ";" else text, encoding="utf-8")
    return path
