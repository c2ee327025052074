"""VTK's XML files, which every ParaView opens: one for each load step, and a `.pvd` that puts them on the time axis.

Time is the index of the load step, since the same load occurs on loading and on unloading; the loads are field data.
pyvista writes the data, compressed: images as raw bytes, which take a quarter less space, meshes in base64, because
meshio 5.3 mixes up the arrays of some files of raw bytes. pyvista writes no `.pvd`, so its few lines are written here.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

from ..base.files import made_folder, replacing, write_text
from .views import View

#: Ending of an image of pixels in a plane.
IMAGE = ".vti"


def write(view: View, folder: Path) -> list[Path]:
    """Write a view: `name.pvd` after the files that it names in the folder `name`; one file if it has no steps.

    Returns
    -------
    Paths of all files, each of which is whole or not there.
    """
    if view.steps is None:
        return [_save(view.at(0), folder / view.name)]
    subfolder = made_folder(folder / view.name)
    index = [int(step) for step in view.steps.index]
    written = [_save(view.at(n), subfolder / f"step_{step:04d}") for n, step in enumerate(index)]
    lines = [
        f'    <DataSet timestep="{step}" part="0" file={quoteattr(f"{view.name}/{path.name}")}/>'
        for step, path in zip(index, written, strict=True)
    ]
    head = ['<?xml version="1.0"?>', '<VTKFile type="Collection" version="0.1">', "  <Collection>"]
    text = "\n".join([*head, *lines, "  </Collection>", "</VTKFile>", ""])
    return [*written, write_text(folder / f"{view.name}.pvd", text)]


def stored(folder: Path, name: str) -> dict[int, Path]:
    """Files of a series of images by their step."""
    return {int(path.stem.removeprefix("step_")): path for path in sorted((folder / name).glob(f"step_*{IMAGE}"))}


def read_image(path: Path, array: str) -> Any:
    """An image with one of its arrays of cells; None if it has no such array."""
    import pyvista

    reader = pyvista.get_reader(path)
    if array not in reader.cell_array_names:
        return None
    reader.disable_all_cell_arrays()
    reader.enable_cell_array(array)
    return reader.read()


def _save(mesh: Any, stem: Path) -> Path:
    import pyvista

    image = isinstance(mesh, pyvista.ImageData)
    path = stem.with_suffix(IMAGE if image else ".vtu")
    writer = (pyvista.XMLImageDataWriter if image else pyvista.XMLUnstructuredGridWriter)(path, mesh).writer
    writer.SetDataModeToAppended()
    writer.SetEncodeAppendedData(not image)
    # VTK crashes where a disk is full, so it writes into memory
    writer.WriteToOutputStringOn()
    if not writer.Write():
        raise OSError(f"VTK could not write {path}")
    content = writer.GetOutputString()
    with replacing(path) as temporary:
        # VTK returns text instead of bytes where the content is valid text
        temporary.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path
