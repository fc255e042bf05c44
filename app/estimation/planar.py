"""The poses of a flat pattern whose plane's fit is known (messages.PlaneFit): no lens, no corners, six numbers at most.

The fit says that W(d) = S^-1 H^-1 [r1 r2 t] S / k is the identity but for a d of known information. Whatever the
rotation, d2 and d5 can be met exactly by the translation, so they are eliminated first; what is left is a least squares
problem of six residuals in the rotation and one scale, and the residual on the pad's normal where the vertical is
known. It knows nothing of detections, and does not choose between the two poses (app.estimation.pose does).
Source: Schweighofer and Pinz, "Robust pose estimation from a planar target", 2006 (why there are two).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from app.estimation.axes import Axes, Vector, cross, dot, weighted
from app.estimation.planar_view import plane_view
from app.frames import Array
from app.messages import PlaneFit

STEPS = 15
CONVERGED = 1e-2
"""Squared sigmas that a step is expected to win for another one to follow it: one of a tenth of a sigma is the last."""
RIDGE = 1e-12
"""Added to the diagonal of an information that is singular, in parts of its mean: a direction that was not seen is no
error."""
SINGULAR = 1e-14
"""Least determinant of the normal matrix, in parts of the product of its diagonal."""

_ORDER = np.array([2, 5, 0, 3, 6, 1, 4, 7])
"""d in the order of elimination: the two that the translation meets, then the columns of r1 and of r2."""
_TAKE = (8 * _ORDER[:, None] + _ORDER[None, :]).astype(np.intp)


def _root(information: Array) -> Array:
    """(8, 8) upper triangular root of the information, d in _ORDER.

    Raises:
        ValueError: It is not positive.
    """
    ordered = information.take(_TAKE)
    try:
        return np.linalg.cholesky(ordered).T
    except np.linalg.LinAlgError:
        ordered.reshape(-1)[::9] += RIDGE * float(ordered.trace()) / 8.0
    try:
        return np.linalg.cholesky(ordered).T
    except np.linalg.LinAlgError:
        raise ValueError("the plane's information is not positive") from None


@dataclass(frozen=True, slots=True)
class _Linear:
    """The problem made linear at a pose, and the scale eliminated.

    Attributes:
        cost: Squared sigmas at the pose.
        matrix: Rows of the (3, 3) normal matrix of the rotation about the cam axes.
        slope: Its right side.
        scale_slope: How the scale's step depends on nothing and on the rotation's.
        scale_gain: What the scale's own step wins.
    """

    cost: float
    matrix: tuple[Vector, Vector, Vector]
    slope: Vector
    scale_slope: tuple[float, Vector]
    scale_gain: float

    def step(self, damping: float) -> tuple[float, float, Vector] | None:
        """Squared sigmas to be won, and the steps of the scale and of the rotation; None where there is none."""
        a, b, c = self.matrix
        if damping > 0.0:
            more = 1.0 + damping
            a, b, c = (more * a[0], a[1], a[2]), (b[0], more * b[1], b[2]), (c[0], c[1], more * c[2])
        # The inverse of a symmetric matrix by its cofactors.
        bc = cross(b, c)
        det = dot(a, bc)
        if not det > SINGULAR * a[0] * b[1] * c[2]:
            return None
        s = self.slope
        w = (-dot(bc, s) / det, -dot(cross(c, a), s) / det, -dot(cross(a, b), s) / det)
        alone, with_rotation = self.scale_slope
        return self.scale_gain - dot(s, w), alone + dot(with_rotation, w), w


@dataclass(frozen=True, slots=True)
class Solution:
    """One local optimum.

    Attributes:
        axes: The rotation.
        scale: Inverse of k.
        cost: Squared sigmas, of the plane and of the vertical.
        tilt_cost: The part of the vertical.
    """

    axes: Axes
    scale: float
    cost: float
    tilt_cost: float


@dataclass(frozen=True, slots=True)
class Start:
    """A pose before refinement.

    Attributes:
        axes: The rotation.
        scale: The best for it.
        cost: Squared sigmas.
    """

    axes: Axes
    scale: float
    cost: float


class PlanarProblem:
    """A plane's fit, and the vertical where it is known, made ready for solving.

    Args:
        plane: The fit.
        down_cam: The vertical in the camera frame, where known.
        tilt_sigma_rad: How far the pad's normal may be from it, about each axis.

    Attributes:
        view: How the plane lies before the camera.
        down: The vertical, as given.

    Raises:
        ValueError: The fit is no plane before the camera, or its information is none.
    """

    def __init__(self, plane: PlaneFit, down_cam: Vector | None, tilt_sigma_rad: float) -> None:
        self.view = plane_view(plane)
        self.down = down_cam
        self._tilt_weight, self._unit_m, self._root = tilt_sigma_rad**-2, plane.unit_m, _root(plane.information)
        rest = self._root[2:, 2:]
        self._aim = rest[:, 0] + rest[:, 4]
        self._gain = (rest.reshape(12, 3) @ (np.array(self.view.rows) * plane.unit_m)).reshape(6, 6)

    def _products(self, axes: Axes, scale: float) -> list[list[float]]:
        """(5, 5) products of the plane's residuals and their derivatives by (scale, rotation about the cam axes)."""
        (fx, fy, fz), (rx, ry, rz), s = axes.forward, axes.right, scale
        fu, fv, fw, ru, rv, rw = s * fx, s * fy, s * fz, s * rx, s * ry, s * rz
        # fmt: off
        columns = np.array((
            fu, fx, 0.0, fw, -fv,
            fv, fy, -fw, 0.0, fu,
            fw, fz, fv, -fu, 0.0,
            ru, rx, 0.0, rw, -rv,
            rv, ry, -rw, 0.0, ru,
            rw, rz, rv, -ru, 0.0,
        )).reshape(6, 5)
        # fmt: on
        z = self._gain @ columns
        z[:, 0] -= self._aim
        result: list[list[float]] = (z.T @ z).tolist()
        return result

    def _tilt_cost(self, axes: Axes) -> float:
        """Squared sigmas between normal and vertical: the length of their difference over the sigma, squared."""
        return 0.0 if self.down is None else 2.0 * self._tilt_weight * (1.0 - dot(axes.normal, self.down))

    def _linear(self, axes: Axes, scale: float) -> _Linear:
        """Plane and vertical at a pose."""
        (cost, g, gx, gy, gz), (_, n, nx, ny, nz), (*_, xx, xy, xz), (*_, yy, yz), (*_, zz) = self._products(
            axes, scale
        )
        if self.down is not None:
            # The residual a - down, a the pad's normal, turns with -[a]x: its square is 1 - a a', its slope down x a.
            a, weight = axes.normal, self._tilt_weight
            ax, ay, az = a
            cost += self._tilt_cost(axes)
            sx, sy, sz = cross(self.down, a)
            gx, gy, gz = gx + weight * sx, gy + weight * sy, gz + weight * sz
            xx, yy, zz = xx + weight * (1.0 - ax * ax), yy + weight * (1.0 - ay * ay), zz + weight * (1.0 - az * az)
            xy, xz, yz = xy - weight * ax * ay, xz - weight * ax * az, yz - weight * ay * az
        ux, uy, uz, alone = -nx / n, -ny / n, -nz / n, -g / n
        xy, xz, yz = xy + ux * ny, xz + ux * nz, yz + uy * nz
        return _Linear(
            cost,
            ((xx + ux * nx, xy, xz), (xy, yy + uy * ny, yz), (xz, yz, zz + uz * nz)),
            (gx + ux * g, gy + uy * g, gz + uz * g),
            (alone, (ux, uy, uz)),
            -g * alone,
        )

    def begin(self, axes: Axes) -> Start | None:
        """A rotation with the scale that suits it best; None if that lies behind the camera."""
        # Linear in the scale: its best value is one division away.
        (cost, slope, *_), (_, normal, *_), *_ = self._products(axes, 1.0)
        scale = 1.0 - slope / normal
        return Start(axes, scale, cost - slope * slope / normal + self._tilt_cost(axes)) if scale > 0.0 else None

    def refine(self, axes: Axes, scale: float = 1.0) -> Solution | None:
        """The local optimum by Gauss-Newton with Levenberg's damping; None if there is none before the camera.

        Args:
            axes: The rotation to start from.
            scale: The scale to start from; it need not be good, the problem being linear in it.
        """
        now = self._linear(axes, scale)
        damping, cost = 0.0, now.cost
        for _ in range(STEPS):
            step = now.step(damping)
            if step is not None:
                gain, more, w = step
                there, size = axes.turned(w), scale + more
                if gain < CONVERGED:
                    axes, scale, cost = there, size, cost - gain
                    break
                tried = self._linear(there, size)
                if size > 0.0 and tried.cost <= cost:
                    axes, scale, now, cost = there, size, tried, tried.cost
                    damping = 0.1 * damping if damping > 1e-4 else 0.0
                    continue
            damping = max(10.0 * damping, 1e-3)
        return Solution(axes, scale, max(cost, 0.0), self._tilt_cost(axes)) if scale > 0.0 else None

    def finish(self, found: Solution) -> tuple[Vector, Array]:
        """Translation of a solution and the (6, 6) information of (translation, rotation about the cam axes)."""
        a, b, c = self.view.rows
        s, root, f, r = found.scale, self._root, found.axes.forward, found.axes.right
        k = s * self._unit_m
        w00, w10, w20, w01, w11, w21 = (k * dot(row, column) for column in (f, r) for row in self.view.rows)
        # The two that were eliminated: the root's first rows are met exactly.
        y0, y1 = (root[:2, 2:] @ np.array((w00 - 1.0, w10, w20, w01, w11 - 1.0, w21))).tolist()
        (r00, r01), (_, r11) = root[:2, :2].tolist()
        w12 = -y1 / r11
        w02 = -(y0 + r01 * w12) / r00
        translation = weighted(
            w02 / s, self.view.columns[0], w12 / s, self.view.columns[1], 1.0 / s, self.view.columns[2]
        )
        # W = A [u r1, u r2, t] / k with k = A3 t, A's rows a, b, c: its derivatives by t, and by a small rotation,
        # which moves a . r by r x a.
        rows = (
            (*weighted(s, a, -s * w02, c, 0.0, c), 0.0, 0.0, 0.0),
            (*weighted(s, b, -s * w12, c, 0.0, c), 0.0, 0.0, 0.0),
            *(
                (-s * w * c[0], -s * w * c[1], -s * w * c[2], k * v[0], k * v[1], k * v[2])
                for w, v in (
                    (w00, cross(f, a)),
                    (w10, cross(f, b)),
                    (w20, cross(f, c)),
                    (w01, cross(r, a)),
                    (w11, cross(r, b)),
                    (w21, cross(r, c)),
                )
            ),
        )
        whitened = root @ np.array(rows)
        information = whitened.T @ whitened
        if self.down is not None:
            x, y, z = found.axes.normal
            information[3:, 3:] += self._tilt_weight * np.array(
                ((1.0 - x * x, -x * y, -x * z), (-x * y, 1.0 - y * y, -y * z), (-x * z, -y * z, 1.0 - z * z))
            )
        return translation, information
