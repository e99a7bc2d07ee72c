"""Read meshes with the normals that their files give, which Pinocchio's reader leaves out."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from twin_gait.viewer.shapes import Shape


def read_obj(path: str | Path) -> Shape | None:
    """Read a Wavefront OBJ file whose corners have normals.

    Args:
        path: The file.

    Returns:
        The mesh, or None for a file without normals or of another kind, which other readers know.
    """
    try:
        lines = [line.split() for line in Path(path).read_text(encoding="utf-8").splitlines()]
        vertices = _numbers(lines, "v")
        normals = _numbers(lines, "vn")
        corners = np.array([corner for line in lines if line[:1] == ["f"] for corner in _fan(line[1:])])
        return _indexed(vertices, normals, corners)
    except (OSError, ValueError, IndexError):
        return None


def _numbers(lines: list[list[str]], kind: str) -> np.ndarray:
    return np.array([[float(word) for word in line[1:4]] for line in lines if line[:1] == [kind]])


def _fan(words: list[str]) -> list[list[tuple[int, int]]]:
    """Triangles of a face, each corner as indices of vertex and normal that count from 1."""
    corners = []
    for word in words:
        vertex, _, normal = word.split("/")  # three parts, or it has no normal
        corners.append((int(vertex), int(normal)))
    return [[corners[0], corners[k], corners[k + 1]] for k in range(1, len(corners) - 1)]


def _indexed(vertices: np.ndarray, normals: np.ndarray, corners: np.ndarray) -> Shape:
    """One vertex for every pair of place and normal.

    Args:
        vertices: Shape ``(n, 3)``.
        normals: Shape ``(k, 3)``.
        corners: Indices that count from 1, shape ``(m, 3, 2)``.

    Returns:
        The mesh.

    Raises:
        ValueError: If an index counts from the end of the file.
        IndexError: If an index has no entry.
    """
    if corners.size == 0 or corners.min() < 1:
        raise ValueError("no faces, or relative indices")
    pairs, index = np.unique(corners.reshape(-1, 2) - 1, axis=0, return_inverse=True)
    turned = normals[pairs[:, 1]]
    turned = turned / np.maximum(np.linalg.norm(turned, axis=1, keepdims=True), 1e-30)
    return Shape(vertices[pairs[:, 0]], turned, index.reshape(-1, 3))
