"""Plot the results of a run, for example by `results.plot.cells()` or `results.plot.seal(step=3)`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import femseal  # its packages are loaded when a method uses them

from ..base import AnyPath, InputError
from ..studies.study_list import TWO_SCALE


class RunPictures:
    """Draw the pictures of a run. Each method returns a Matplotlib figure, which notebooks display.

    Parameters
    ----------
    results : Results
        Results of the run.
    """

    def __init__(self, results: Any) -> None:
        self._results = results

    def __call__(self, **options: Any) -> Any:
        """Draw the leakage against the load, see `leakage`."""
        return femseal.plots.picture(self._results, **options)

    def leakage(self) -> Any:
        """Draw the leakage against the load, with its 95 % interval and the limits of the leakage classes."""
        return self._shown("leakage_figure", self._results)

    def test(self) -> Any:
        """Draw the leakage of the test fluid against the load.

        Raises
        ------
        InputError
            The run has no test fluid.
        """
        self._require("test_leakage", "a run with output.test_fluid")
        return self._shown("leak_test_figure", self._results)

    def cells(self) -> Any:
        """Draw the permeability of the cells against their mean gap and their contact pressure."""
        return self._shown("cells_figure", self._results)

    def seal(self, step: int | None = None) -> Any:
        """Draw contact pressure, gap and fluid pressure over the seal at one load.

        Parameters
        ----------
        step : int, optional
            Index of the load step; by default the step with the highest load at which the seal still leaks.
        """
        return self._shown("seal_figure", self._results, step)

    def pressure(self, step: int | None = None) -> Any:
        """Draw the fluid pressure from inlet to outlet, with a line for each load at which the seal leaks.

        Parameters
        ----------
        step : int, optional
            Index of the load step for which the range of the fluid pressure over the seal is shaded; by default the
            last step at which the seal leaks.
        """
        self._require("face_fluid_pressure", "a run that solved the surface")
        return self._shown("pressure_figure", self._results, step)

    def surface(self) -> Any:
        """Draw the heights of the surface as a shaded relief."""
        if self._results.scene is not None:
            return self._shown("heights_figure", self._results.scene.surface)
        self._require("face_height", "a run that solved the surface")
        return self._shown("surface_figure", self._results.dataset)

    def realisation(self, step: int | None = None) -> Any:
        """Draw the realisation whose leakage is nearest to the median leakage.

        Parameters
        ----------
        step : int, optional
            Index of the load step; by default the step with the highest load at which the seal still leaks.

        Raises
        ------
        InputError
            The run has no realisations, or no maps of the surface.
        """
        self._require("drawn_corners", "a stochastic run")
        self._require(
            "face_gap", f"a run that also solved the surface, compare = ['{TWO_SCALE.name}']"
        )
        data = self._results.dataset
        chosen = femseal.plots.maps.default_step(data) if step is None else step
        return self._shown("realisation_figure", data, chosen)

    def write(
        self,
        folder: AnyPath | None = None,
        formats: Sequence[str] = ("png",),
        names: Sequence[str] = (),
        step: int | None = None,
    ) -> list[Path]:
        """Write pictures of the run to files, for example `results.plot.write("figures", ["svg", "pdf"])`.

        Parameters
        ----------
        folder : path, optional
            Folder of the files, which is created if needed; by default the folder of the results.
        formats : sequence of {"png", "svg", "pdf"}
            File formats. In SVG and PDF files, text and lines stay sharp when a picture is enlarged, and maps contain
            all pixels.
        names : sequence of str
            Names of the pictures, such as "leakage" and "cells"; by default all pictures for which the results contain
            data.
        step : int, optional
            Index of the load step of the maps; by default the step with the highest load at which the seal leaks.

        Returns
        -------
        list of Path
            Paths of the files.

        Raises
        ------
        InputError
            A format, a name or a step is unknown, the results have no data for a picture, or the folder cannot be
            created.
        """
        return femseal.report.write_pictures(self._results, folder, formats, names, step)

    def __repr__(self) -> str:
        names = [name for name in dir(type(self)) if not name.startswith("_")]
        return f"<pictures of a run: plot(), {', '.join(f'plot.{name}()' for name in names)}>"

    def _shown(self, name: str, *arguments: Any) -> Any:
        """Draw a picture with the function `name` of `femseal.plots`, and show the picture."""
        return femseal.plots.shown(getattr(femseal.plots, name)(*arguments))

    def _require(self, variable: str, expected: str) -> None:
        """Raise an InputError if the dataset lacks a variable."""
        if variable not in self._results.dataset:
            raise InputError("plot", f"results without {variable}", expected)
