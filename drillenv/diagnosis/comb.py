"""Sines at the harmonics of a tone and its subharmonics, fitted by least squares in the frequency domain."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import signal, special
from scipy.sparse.linalg import LinearOperator, cg

Floats = NDArray[np.float64]
Orders = tuple[int, ...]
"""q in the harmonics of tone / q: 1 for the tone itself, 2 for half of it, and so on."""


def without_harmonics(samples: Floats, tone: float, orders: Orders) -> Floats:
    """A series (n,) less its mean and all harmonics of tone / order; the tone in cycles per sample.

    The products of the sines form a Toeplitz matrix, of Dirichlet's kernel, so that conjugate gradients with fast
    Fourier transforms solve the normal equations of thousands of sines in milliseconds.
    """
    made = _plan(samples.size, tone, orders)
    right = np.where(made.wanted, made.centre * made.forth(samples), 0.0)
    k, length = right.size, 2 * right.size - 1

    def product(x: NDArray[np.complex128]) -> NDArray:
        folded = np.fft.ifft(np.fft.fft(made.mask * x.ravel(), made.spectrum.size) * made.spectrum)
        return made.mask * folded[:length]

    operator = LinearOperator((length, length), matvec=product, dtype=complex)  # pyright: ignore[reportCallIssue]
    found, _ = cg(operator, np.concatenate([right[:0:-1].conj(), right]), rtol=1e-7, maxiter=60)
    factors = found[k - 1 :]
    factors[1:] *= 2.0
    return samples - np.real(made.back(factors * made.centre.conj()))


class _Plan(NamedTuple):
    """What depends on the tone and on how many samples there are, and not on them."""

    wanted: NDArray[np.bool_]
    """(k,) whether there is one, from 0 on."""
    centre: NDArray[np.complex128]
    """(k,) phases with which time counts from the middle of the series: this makes the kernel real."""
    mask: NDArray[np.bool_]
    """(2 k - 1,) the same on both sides of 0."""
    spectrum: NDArray[np.complex128]
    """Of the circulant matrix that the Toeplitz matrix is a part of."""
    forth: signal.CZT
    back: signal.CZT


@lru_cache(maxsize=64)
def _plan(n: int, tone: float, orders: Orders) -> _Plan:
    step = tone / math.lcm(*orders)
    k = np.arange(int((0.5 - 1.0 / n) / step) + 1)
    wanted = np.any([k % (math.lcm(*orders) // order) == 0 for order in orders], axis=0)
    kernel = n * special.diric(2.0 * np.pi * step * np.arange(2 * k.size - 1), n)
    circulant = np.zeros(1 << (2 * kernel.size - 1).bit_length())
    circulant[: kernel.size] = kernel
    circulant[circulant.size - kernel.size + 1 :] = kernel[:0:-1]
    return _Plan(
        wanted,
        np.exp(1j * np.pi * step * (n - 1) * k),
        np.concatenate([wanted[:0:-1], wanted]),
        np.fft.fft(circulant),
        _transform(n, k.size, -step),
        _transform(k.size, n, step),
    )


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
