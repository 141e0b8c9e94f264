"""Sines at the harmonics of a tone and its subharmonics, fitted by least squares in the frequency domain."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, signal, special
from scipy.sparse.linalg import LinearOperator, cg

Floats = NDArray[np.float64]
Orders = tuple[int, ...]
"""q in the harmonics of tone / q: 1 for the tone itself, 2 for half of it, and so on."""


class Comb(NamedTuple):
    """A series without its sines at the harmonics of a tone."""

    rest: Floats
    """(n,), what the sines and the mean leave."""
    tones: NDArray
    """(lines,), the harmonics below the Nyquist frequency, in cycles per sample."""
    power: Floats
    """(lines,), the sum of squares each explains: two degrees of freedom of the noise."""


def off_comb(samples: Floats, tone: float, orders: Orders) -> Comb:
    """Take the mean and all harmonics of tone / order out of a series (n,); the tone in cycles per sample.

    The products of the sines form a Toeplitz matrix, of Dirichlet's kernel, so that conjugate gradients with fast
    Fourier transforms solve the normal equations of thousands of sines in milliseconds.
    """
    n = samples.size
    step = tone / math.lcm(*orders)
    k = np.arange(int((0.5 - 1.0 / n) / step) + 1)
    wanted = np.any([k % (math.lcm(*orders) // order) == 0 for order in orders], axis=0)
    centre = np.exp(1j * np.pi * step * (n - 1) * k)  # time counted from the middle makes the kernel real
    right = np.where(wanted, centre * _transform(n, k.size, -step)(samples), 0.0)
    kernel = n * special.diric(2.0 * np.pi * step * np.arange(2 * k.size - 1), n)
    mask = np.concatenate([wanted[:0:-1], wanted])

    def product(x: NDArray[np.complex128]) -> NDArray:
        return mask * linalg.matmul_toeplitz(kernel, mask * x.ravel())

    operator = LinearOperator((mask.size, mask.size), matvec=product, dtype=complex)  # pyright: ignore[reportCallIssue]
    found, _ = cg(operator, np.concatenate([right[:0:-1].conj(), right]), rtol=1e-7, maxiter=60)
    factors = found[k.size - 1 :]
    power = 2.0 * np.real(factors.conj() * right)
    factors[1:] *= 2.0
    fitted = np.real(_transform(k.size, n, step)(factors * centre.conj()))
    harmonics = wanted & (k > 0)
    return Comb(samples - fitted, step * k[harmonics], power[harmonics])


@lru_cache(maxsize=16)
def _transform(size: int, count: int, step: float) -> signal.CZT:
    """Sums of a series (size,) times exp(2 pi i step j k), over j, for k = 0 ... count - 1."""
    return signal.CZT(size, count, np.exp(2j * np.pi * step))


def distances(bins: NDArray, n: int, tone: float, orders: Orders) -> tuple[Floats, Floats]:
    """Of bins of the transform of n samples: bins to the nearest harmonic, and leverage of the harmonics there.

    The leverage is the share of the noise of a bin that the fit of nearly orthogonal sines takes away.
    """
    places = np.unique(np.concatenate([np.arange(-order, 2 * order) / order for order in orders]))
    away = (np.mod(np.asarray(bins) / (n * tone), 1.0)[..., None] - places) * n * tone
    return np.abs(away).min(axis=-1), np.sum(np.sinc(away) ** 2, axis=-1)
