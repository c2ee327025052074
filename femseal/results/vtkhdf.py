"""VTKHDF, VTK's format in HDF5: one compressed file for all load steps, with a mesh that is stored once.

Written by VTK's own writer. It leaves out the field data of images (VTK 9.7), which h5py adds. Time is the
index of the load step, since the same load occurs on loading and on unloading; the loads are field data. ParaView 5.13
or later reads it.
"""

from __future__ import annotations

import errno
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np

from ..base.files import replacing
from .views import LoadSteps, View

#: Suffix by which ParaView recognises the files.
SUFFIX = ".vtkhdf"
#: Of deflate: higher levels gain a few per cent at several times the time.
_LEVEL = 1


def write(view: View, folder: Path) -> list[Path]:
    """Write a view with all its steps into one file, which is whole or not there."""
    from vtkmodules.vtkIOHDF import vtkHDFWriter

    path = folder / f"{view.name}{SUFFIX}"
    first = view.at(0)
    size = 1024 * first.GetActualMemorySize() * (1 if view.steps is None else len(view.steps.index))
    if shutil.disk_usage(folder).free < size:
        # HDF5 crashes or hangs where a disk is full
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
    with replacing(path) as target:
        writer = vtkHDFWriter()
        writer.SetFileName(str(target))
        writer.SetCompressionLevel(_LEVEL)
        if view.steps is None:
            writer.SetInputData(first)
        else:
            source = _source(view, view.steps)
            writer.SetInputConnection(source.GetOutputPort())
            writer.SetWriteAllTimeSteps(True)
        if not writer.Write():
            raise OSError(f"VTK could not write {target}")
        if view.steps is not None:
            _add_field_data(target, view.steps)
    return [path]


def _source(view: View, steps: LoadSteps) -> Any:
    """The view as a source of VTK that passes one step after the other to the writer."""
    from vtkmodules.util.vtkAlgorithm import VTKPythonAlgorithmBase
    from vtkmodules.vtkCommonDataModel import vtkDataObject, vtkImageData
    from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline as Pipeline

    times = [float(step) for step in steps.index]
    first = view.at(0)

    class Source(VTKPythonAlgorithmBase):
        def __init__(self) -> None:
            super().__init__(nInputPorts=0, nOutputPorts=1, outputType=first.GetClassName())

        def RequestInformation(self, request: Any, inputs: Any, outputs: Any) -> int:
            information = outputs.GetInformationObject(0)
            information.Set(Pipeline.TIME_STEPS(), times, len(times))
            information.Set(Pipeline.TIME_RANGE(), [times[0], times[-1]], 2)
            if isinstance(first, vtkImageData):
                information.Set(Pipeline.WHOLE_EXTENT(), first.GetExtent(), 6)
            return 1

        def RequestData(self, request: Any, inputs: Any, outputs: Any) -> int:
            information = outputs.GetInformationObject(0)
            asked = information.Has(Pipeline.UPDATE_TIME_STEP())
            time = information.Get(Pipeline.UPDATE_TIME_STEP()) if asked else times[0]
            output = vtkDataObject.GetData(outputs, 0)
            output.ShallowCopy(view.at(times.index(time)))
            output.GetInformation().Set(vtkDataObject.DATA_TIME_STEP(), time)
            return 1

    return Source()


def _add_field_data(path: Path, steps: LoadSteps) -> None:
    """Add one value of the field data for each step where VTK's writer has left them out."""
    import h5py

    count = len(steps.index)
    with h5py.File(path, "a") as file:
        root = file["VTKHDF"]
        if "FieldData" in root:
            return
        data = root.create_group("FieldData")
        offsets, sizes = (root["Steps"].create_group(f"FieldData{name}") for name in ("Offsets", "Sizes"))
        for name, values in steps.fields.items():
            data.create_dataset(name, data=values)
            offsets.create_dataset(name, data=np.arange(count, dtype=np.int64))
            # components and tuples
            sizes.create_dataset(name, data=np.ones((count, 2), np.int64))
