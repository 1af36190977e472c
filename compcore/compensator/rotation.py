"""Rotations of single vectors in Python floats: 3×3 matrices as tuples of nine, row by row."""

from __future__ import annotations

import math
from collections.abc import Sequence

Triple = tuple[float, float, float]
Nine = tuple[float, float, float, float, float, float, float, float, float]

IDENTITY: Nine = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
"""No rotation; known by identity (``is``), so that it costs nothing."""


def apply(m: Nine, x: float, y: float, z: float) -> Triple:
    """``m·r``."""
    a, b, c, d, e, f, g, h, i = m
    return a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z


def shifted(m: Nine, x: float, y: float, z: float) -> Triple:
    """``m·r − r``."""
    a, b, c, d, e, f, g, h, i = m
    return a * x + b * y + c * z - x, d * x + e * y + f * z - y, g * x + h * y + i * z - z


def transposed(m: Nine) -> Nine:
    """A rotation backwards."""
    a, b, c, d, e, f, g, h, i = m
    return a, d, g, b, e, h, c, f, i


def product(m: Nine, n: Nine) -> Nine:
    """``m·n``."""
    a, b, c, d, e, f, g, h, i = m
    j, k, u, v, w, o, p, q, r = n
    return (
        a * j + b * v + c * p,
        a * k + b * w + c * q,
        a * u + b * o + c * r,
        d * j + e * v + f * p,
        d * k + e * w + f * q,
        d * u + e * o + f * r,
        g * j + h * v + i * p,
        g * k + h * w + i * q,
        g * u + h * o + i * r,
    )


def about(direction: Triple, angle: float) -> Nine:
    """A right-handed turn about a unit vector (Rodrigues), angle in rad."""
    x, y, z = direction
    s, c = math.sin(angle), math.cos(angle)
    t = 1.0 - c
    return (
        c + t * x * x,
        t * x * y - s * z,
        t * x * z + s * y,
        t * x * y + s * z,
        c + t * y * y,
        t * y * z - s * x,
        t * x * z - s * y,
        t * y * z + s * x,
        c + t * z * z,
    )


def about_xyz(a: float, b: float, c: float) -> Nine:
    """``Rx(a)·Ry(b)·Rz(c)``, angles in rad."""
    ca, sa, cb, sb, cc, sc = (
        math.cos(a),
        math.sin(a),
        math.cos(b),
        math.sin(b),
        math.cos(c),
        math.sin(c),
    )
    return (
        cb * cc,
        -cb * sc,
        sb,
        ca * sc + sa * sb * cc,
        ca * cc - sa * sb * sc,
        -sa * cb,
        sa * sc - ca * sb * cc,
        sa * cc + ca * sb * sc,
        ca * cb,
    )


def solved(columns: Sequence[Triple], x: float, y: float, z: float) -> Triple:
    """How far along each of three directions (mm) a displacement goes (Cramer's rule)."""
    (a, d, g), (b, e, h), (c, f, i) = columns
    ei_fh, fg_di, dh_eg = e * i - f * h, f * g - d * i, d * h - e * g
    whole = a * ei_fh + b * fg_di + c * dh_eg
    return (
        (x * ei_fh + b * (f * z - y * i) + c * (y * h - e * z)) / whole,
        (a * (y * i - f * z) + x * fg_di + c * (d * z - y * g)) / whole,
        (a * (e * z - y * h) + b * (y * g - d * z) + x * dh_eg) / whole,
    )
