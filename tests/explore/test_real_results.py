"""The page shows what `pdssjax identify --intervals profile` and `pdssjax sweep` have really left."""

import numpy as np
import platform_study
import pytest
from browser import opened_page, said, served, show_tab, visible_plots
from walking_study import write_walk, write_walking

from pdssjax import load_study
from pdssjax.cli import main as cli


def simulate_walk(study_file):
    """Replaces the made-up walk by that of the study's law, which an estimate from the step has to predict."""
    study = load_study(study_file)
    numbers = study.values() | {
        "piezo.gain": platform_study.GAIN,
        "piezo.natural_frequency": platform_study.RATE,
        "piezo.damping_ratio": platform_study.DAMPING,
    }
    (index,) = (i for i, record in enumerate(study.records) if record.name == "walk")
    write_walk(study_file.parent, study.records[index].time, np.asarray(study.predict(numbers)[index]))


@pytest.mark.slow
def test_real_profiles_and_a_real_map_are_shown_on_a_small_screen(tmp_path):
    study, results, sweep = write_walking(tmp_path), tmp_path / "results", tmp_path / "map"
    simulate_walk(study)
    assert cli.main(["identify", str(study), "--intervals", "profile", "--out", str(results)]) == 0
    axes = ["--voltage", "40:70:4", "--frequency", "10,20,40", "--cycles", "steady"]
    estimate = ["--estimate", str(results / "estimate.json")]
    assert cli.main(["sweep", str(study), *estimate, *axes, "--out", str(sweep)]) == 0
    with (
        served(tmp_path, str(study), *estimate, "--sweep", str(sweep)) as address,
        opened_page(address) as (page, errors, _),
    ):
        show_tab(page, "Estimate")
        said(page, "estimate", "Walking rig: joint fit, converged")
        page.wait_for_timeout(1500)
        # Correlations, and a profile of each of three parameters.
        assert len(visible_plots(page, "estimate-plots")) >= 4
        show_tab(page, "Sweep")
        said(page, "point-told", r"point 6: drive.voltage: 60 V, drive.frequency: 10 Hz.*motion repeats: 1,")
        assert len(visible_plots(page, "map")) >= 2
        assert page.evaluate("document.scrollingElement.scrollWidth") <= 1366
        assert errors == []
