"""Copies of a user's own files in a folder, so that it opens on another machine: URDF, meshes and DBC.

Person, gait table and modes need no copy: ``experiment.yaml`` has their content.
"""

import warnings
from pathlib import Path

from twin_gait.experiment import Experiment
from twin_gait.files import shipped_file, write_atomically
from twin_gait.leg_model.urdf import find_urdf
from twin_gait.network.dbc import find_dbc

FILES_FOLDER = "files"


def store_files(experiment: Experiment, folder: Path) -> dict[str, str]:
    """Copy the files that an experiment names, unless they ship with the package.

    Returns their names in ``experiment.yaml`` by section: the path in ``folder`` of a copy, or the name of a
    file that ships. Raises RunDirectoryError if a copy cannot be written.
    """
    urdf = find_urdf(experiment.leg.urdf)
    names = {"leg": _stored(urdf, folder)}
    if names["leg"] != urdf.name:
        _store_meshes(urdf, folder / FILES_FOLDER)
    if experiment.network is not None:
        names["network"] = _stored(find_dbc(experiment.network.dbc), folder)
    return names


def _stored(path: Path, folder: Path) -> str:
    content, shipped = path.read_bytes(), shipped_file(path.name)
    if shipped is not None and shipped.read_bytes() == content:
        return path.name
    copy = Path(FILES_FOLDER, path.name)
    (folder / copy).parent.mkdir(exist_ok=True)
    write_atomically(folder / copy, content)
    return copy.as_posix()


def _store_meshes(urdf: Path, folder: Path) -> None:
    from twin_gait.viewer.visuals import mesh_files, stored_mesh  # the viewer takes its time to import

    for name, path in mesh_files(urdf).items():
        copy = stored_mesh(name, folder)
        try:
            content = path.read_bytes()
        except OSError as error:
            warnings.warn(f"{path}: mesh cannot be copied ({error.strerror})", stacklevel=2)
            continue
        copy.parent.mkdir(exist_ok=True)
        write_atomically(copy, content)
