"""A tissue that close-loop found in homogeneous tests runs in elements: the model file separates the two Poisson's ratios."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from explicitfe.fem.solve.stagnation import ITERATIONS_WITHOUT_PROGRESS, MOST_ITERATIONS_WITHOUT_PROGRESS, Stagnation
from explicitfe.inverse.measured.read import read_dataset
from explicitfe.inverse.predict.experiment import experiments
from explicitfe.inverse.predict.predict import predict_test
from explicitfe.inverse.predict.tissue import INCOMPRESSIBLE_POISSON_RATIO, Constants, Tissue, parse_tissue
from explicitfe.inverse.predict.tissue_in_scenario import tissue_settings
from explicitfe.platform.host.digits import distinct
from explicitfe.platform.host.shipped import datasets
from explicitfe.simulate.run.run import run
from explicitfe.simulate.scenario.read import read_scenario

REAR = Path(__file__).parents[2] / "scenarios" / "indentation-rear.toml"
VISCOELASTIC = "effects.viscoelastic={ g = [0.35], tau_s = [3.0] }"
GEL = Tissue(incompressible=True, constants={"*": Constants(C10_Pa=899.0, C20_Pa=398.0)})


def test_the_model_file_keeps_both_ratios_apart():
    again = parse_tissue(GEL.text)
    assert again == GEL and again.poisson == 0.499
    curve = read_dataset(datasets()["simulated-compression"]).curves[0]
    assert GEL.law(curve).poisson == 0.499
    assert GEL.law(curve, homogeneous=True).poisson == INCOMPRESSIBLE_POISSON_RATIO
    assert "incompressible" not in GEL.model_copy(update={"incompressible": False}).text


def test_a_scenario_takes_the_ratio_of_elements():
    settings, _ = tissue_settings(GEL, read_scenario(REAR)[0])
    assert "poisson = 0.499," in settings[0]


def test_a_homogeneous_test_is_computed_in_the_incompressible_limit():
    """The same answer as with a file of version 0.22, which states poisson = 0.49999 for everything."""
    dataset = read_dataset(datasets()["simulated-compression"])
    test = experiments(dataset.curves[:1])[0]
    before = GEL.model_copy(update={"incompressible": False, "poisson": INCOMPRESSIBLE_POISSON_RATIO})
    compressible = GEL.model_copy(update={"incompressible": False})
    new, old, other = (predict_test(test, tissue)[0].values for tissue in (GEL, before, compressible))
    assert np.array_equal(new, old) and not np.array_equal(new, other)


def test_nearly_incompressible_tissue_converges_in_elements(tmp_path):
    """The residual was below the tolerance, but the slow kinetic energy did not count as progress: "not-converged" after 70 s."""
    settings = [
        "model.symmetry=sector",
        "model.material={ C10_Pa = 899.0, C20_Pa = 398.0, poisson = 0.49999, density_kg_m3 = 1040.0 }",
        VISCOELASTIC,
        "analysis.forces_N=[0.1]",
    ]
    summary = run(REAR, tmp_path, settings=settings)
    assert summary["status"] == "finished", summary["message"]
    assert summary["curve"][0]["displacement_mm"] == pytest.approx(0.251, rel=5e-3)


def test_slow_decay_of_kinetic_energy_is_progress():
    stagnation = Stagnation(slowly=False)
    for k in range(100):
        stagnation.count(400)
        stagnation.check(5e-5, 1e-4 * 0.7**k, 1.5e-5)
    assert not stagnation.is_stalled
    for _ in range(ITERATIONS_WITHOUT_PROGRESS // 400):
        assert not stagnation.is_stalled
        stagnation.count(400)
        stagnation.check(5e-5, 1e-4, 1.5e-5)
    assert stagnation.is_stalled


@pytest.mark.parametrize(("stiffness", "limit"), [(1.5e-5, ITERATIONS_WITHOUT_PROGRESS), (1.5e-7, 32_447), (0.0, 60_000)])
def test_the_slowest_mode_has_two_periods(stiffness, limit):
    stagnation = Stagnation(slowly=False)
    stagnation.check(1.0, 1.0, stiffness)
    assert stagnation.limit == pytest.approx(limit, rel=1e-3) and stagnation.limit <= MOST_ITERATIONS_WITHOUT_PROGRESS


@pytest.mark.parametrize(
    ("one", "other", "texts"),
    [(0.1290, 0.1287, ("0.1290", "0.1287")), (0.12864, 0.12871, ("0.12864", "0.12871")), (0.0, 0.3, ("0.000", "0.3000"))],
)
def test_messages_have_enough_digits(one, other, texts):
    assert distinct(one, other) == texts
