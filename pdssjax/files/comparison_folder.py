"""Compares models and writes the results: each candidate as soon as it is fitted, the comparison at the end."""

import dataclasses
import io
import json
import shutil
import warnings
import zipfile
from collections.abc import Iterable, Sequence
from concurrent.futures import Executor
from pathlib import Path

import numpy as np

from ..core import Document, InputError, InputWarning, installed_versions
from ..inference import Progress
from ..report.page import comparison_page, write_page
from ..report.text import format_selection
from ..selection import EFFORT, Candidate, Comparison, FittedCandidate, compare_models
from ..study import Estimate, Study
from .estimate_results import write_essentials
from .json_text import json_text
from .results_folder import CANDIDATES, reserved_folder, staging_folder, write_text, write_whole

FORMAT, CANDIDATE_FORMAT = "pdssjax-comparison/1", "pdssjax-candidate/1"

_CANDIDATE = "candidate.npz"
"""The file beside a candidate's estimate with its `FittedCandidate`."""

_RESULTS = "comparison.txt", "comparison.png", "residuals.png", "comparison.html", "comparison.json"
"""Names of the files of a comparison, the main one last."""


def compare(
    study: Study,
    *,
    friction: Iterable[str] | None = None,
    piezo: Iterable[str] | None = None,
    feedback: Iterable[bool] | None = None,
    effort: str = EFFORT,
    executor: Executor | None = None,
    out: str | Path | None = None,
    resume: bool = False,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> Comparison:
    """Fit a study's records under its own model and others, and find the simplest one that predicts as well as any.

        study = pdssjax.load_study("study.toml")
        comparison = pdssjax.compare(study, friction=["coulomb", "dahl", "lugre"], out="which-law")
        print(comparison.chosen, comparison.ambiguous)

    Models are judged by held-out samples: blocks of time and whole records are left out of the fit in turn, under one
    noise for all models, which is coloured where the residuals are.

    **Arguments:**

    - `study`: its records with role "fit" are fitted, those with role "validate" only predicted.
    - `friction`: names of laws to compare with the study's own; ["all"] for every law, the default if `piezo`
      and `feedback` are left out.  "anisotropic-lugre:force" is a law with that reading of its state.
    - `piezo`: names of models of stack and platform.  All combinations of laws and models are compared.
    - `feedback`: [True] or [False] adds the other reading of whether friction acts back on the platform.
    - `effort`: of each fit, "quick", "usual" or "thorough".
    - `executor`: runs the fits; None spawns processes, one a core.
    - `out`: a folder for the results; each candidate goes to `candidates` in it once its fit is done.
    - `resume`: do not fit candidates again that `out` holds, of the same study, records and effort.
    - `overwrite`: replace results in `out`.
    - `progress`: takes lines of text; if left out, notebooks show a bar.

    **Returns:** the `Comparison`, also of models that cannot be fitted, with the reason.

    **Raises:** `InputError` for an unknown name, where there is nothing to compare or to resume, and where `out` holds
    results or another process uses it.
    """
    options = {"friction": friction, "piezo": piezo, "feedback": feedback, "effort": effort}
    if out is None:
        if resume or overwrite:
            raise InputError("out: found none, expected a folder to resume or to overwrite.")
        return compare_models(study, **options, executor=executor, progress=progress)
    folder = Path(out)
    with reserved_folder(folder, overwrite or resume):
        store = CandidateFolder(folder, resume)
        comparison = compare_models(study, **options, executor=executor, progress=progress, store=store)
        write_selection(comparison, folder)
    return comparison


class CandidateFolder:
    """A store of fitted candidates in `candidates/NAME` of a folder, each with its identification.

    **Arguments:** the `folder` of the comparison; whether to `resume` its candidates, or to remove them.

    **Raises:** `InputError` where there is nothing to resume.
    """

    def __init__(self, folder: Path, resume: bool):
        self.place = folder / CANDIDATES
        if resume and not self.place.is_dir():
            raise InputError(f"{self.place}: found nothing to resume, expected the candidates of a comparison.")
        if not resume and self.place.exists():
            shutil.rmtree(self.place)
        self._warned = False

    def kept(self, candidate: Candidate, digest: str) -> FittedCandidate | None:
        """The stored candidate with this `digest`; None where there is none, or another one."""
        file = self.place / candidate.folder / _CANDIDATE
        try:
            return _read(file, digest)
        except FileNotFoundError:
            return None
        except (OSError, ValueError, KeyError, TypeError, zipfile.BadZipFile) as error:
            warnings.warn(
                f"{file}: found no candidate that can be read ({error}); it is fitted again.", InputWarning, 2
            )
            return None

    def keep(self, candidate: Candidate, digest: str, fitted: FittedCandidate, estimate: Estimate | None) -> None:
        """Write a candidate's results; where that fails the comparison goes on in memory, and warns once."""
        folder = self.place / candidate.folder
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if estimate is not None:
                write_essentials(estimate, folder)
            if not fitted.failure:
                _write(folder / _CANDIDATE, digest, fitted)
        except OSError as error:
            if not self._warned:
                message = f"{folder}: cannot be written ({error.strerror or error}); the comparison goes on in memory."
                warnings.warn(message, InputWarning, stacklevel=2)
            self._warned = True


_ARRAYS = "residuals", "held_out"


def _write(file: Path, digest: str, fitted: FittedCandidate) -> None:
    """Write a candidate into its file."""
    plain = {f.name: getattr(fitted, f.name) for f in dataclasses.fields(fitted) if f.name not in _ARRAYS}
    of_json = lambda value: value.item() if isinstance(value, np.generic) else dict(value)
    document = json.dumps({"format": CANDIDATE_FORMAT, "digest": digest, **plain}, default=of_json)
    arrays = {f"{name}_{k}": array for name in _ARRAYS for k, array in enumerate(getattr(fitted, name))}
    content = io.BytesIO()
    np.savez(content, document=np.array(document), **arrays)
    write_whole(file, content.getvalue())


def _read(file: Path, digest: str) -> FittedCandidate | None:
    """The candidate in a `file`; None where it has another digest or format."""
    with np.load(file, allow_pickle=False) as content:
        document: Document = json.loads(str(content["document"]))
        if document.pop("format") != CANDIDATE_FORMAT or document.pop("digest") != digest:
            return None
        for name in _ARRAYS:
            count = sum(key.startswith(f"{name}_") for key in content.files)
            document[name] = tuple(content[f"{name}_{k}"] for k in range(count))
        for name in ("free", "at_bound"):
            document[name] = tuple(document[name])
    return FittedCandidate(**document)


def write_selection(comparison: Comparison, folder: Path, commands: Sequence[str] = ()) -> None:
    """Put text, figures, page and `comparison.json` of a comparison into `folder`, in place of older ones.

    **Arguments:** the `commands` that repeat the comparison, for the page.
    """
    from ..report.figures import residual_strips_figure, save_figure, selection_figure

    versions = ", ".join(f"{name} {version}" for name, version in installed_versions().items())
    with staging_folder(folder, _RESULTS) as staging:
        write_text(staging / "comparison.txt", format_selection(comparison))
        if comparison.chosen:
            save_figure(selection_figure(comparison), staging / "comparison.png")
            save_figure(residual_strips_figure(comparison), staging / "residuals.png")
        write_page(staging / "comparison.html", comparison_page(comparison, [f"Computed with {versions}."], commands))
        write_text(staging / "comparison.json", comparison_text(comparison))


def comparison_text(comparison: Comparison) -> str:
    """The contents of `comparison.json`; SI."""
    document: Document = {
        "format": FORMAT,
        "title": comparison.title,
        "chosen": comparison.chosen or None,
        "best": comparison.best or None,
        "groups": [list(group) for group in comparison.groups],
        "blocks": comparison.blocks,
        "whole_records": comparison.whole_records,
        "noise": {name: noise._asdict() for name, noise in comparison.noise.items()},
        "telling": comparison.telling and comparison.telling._asdict(),
        "seconds": comparison.seconds,
        "models": [],
    }
    names = "name model free failure converged explained message values units errors refitted start seconds".split()
    for result in comparison.results:
        entry = {name: getattr(result.fitted, name) for name in names}
        for name, pair in (("held_out_time", result.time), ("held_out_records", result.records)):
            entry[name] = pair and {"worse_by": pair.total, "standard_error": pair.standard_error}
        entry |= {"criterion": result.criterion, "group": result.group, "worse": result.is_worse}
        document["models"].append(entry | {"misfit": result.misfit and result.misfit._asdict()})
    return json_text(document)
