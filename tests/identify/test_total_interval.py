"""The total interval of a constant, which includes what the dataset leaves open, and the sentence on its use."""

from __future__ import annotations

import numpy as np
import pytest
from identify_cases import COARSE, CYLINDER, TRUTH, response, write, write_homogeneous

from explicitfe.app.api.inverse import identify
from explicitfe.app.view.page.identify import identify_page
from explicitfe.app.view.terminal.identify import identification_tables
from explicitfe.inverse.identify import total
from explicitfe.inverse.identify.total import total_interval


def test_changes_to_one_side_widen_this_side_only():
    """Independent half widths add in squares: 3 and 4 below are 5, and above there is no change."""
    changes = np.array([-4.0, 0.0])
    assert total_interval(10.0, (7.0, 12.0), changes) == pytest.approx([5.0, 12.0])
    assert total_interval(1.0, (0.5, 2.0), changes)[0] == 0.0
    assert total_interval(-1.0, (-2.0, 0.5), changes) == pytest.approx([-1.0 - np.hypot(1.0, 4.0), 0.5])
    assert total_interval(1.0, (0.5, np.inf), changes)[1] == np.inf


def test_a_layer_that_is_not_stated_is_in_the_interval_and_a_stated_one_is_not(tmp_path):
    """The case of the report: 0.4 % from the data beside a layer that would change C10 by some ten percent."""
    loads = np.linspace(0.1, 0.7, 9)
    depths = response().at_force(loads, *TRUTH)[0]
    depths = depths + 1e-5 * np.random.default_rng(7).standard_normal(len(depths))
    groups = {}
    for name, specimen in (("open", CYLINDER), ("stated", f"{CYLINDER}\nlayer_mm = 0.0")):
        folder = write(tmp_path / name, {"one": (depths, loads)})
        toml = (folder / "dataset.toml").read_text("utf-8")
        (folder / "dataset.toml").write_text(toml.replace(CYLINDER, specimen), encoding="utf-8")
        answer = identify(folder, refinement=COARSE)
        groups[name] = answer["groups"]["all"]
    rows = {name: {row["if"]: row for row in group["hides"]} for name, group in groups.items()}
    layer = next(name for name in rows["open"] if "surface layer" in name)
    assert rows["open"][layer]["left_open"] and not rows["stated"][layer]["left_open"]
    assert not rows["open"]["sticking contact"]["left_open"]  # The dataset states the friction.
    for group in groups.values():
        for entry in group["constants"].values():
            assert entry["total95"][0] <= entry["ci95"][0] < entry["ci95"][1] <= entry["total95"][1]
    C10, change = groups["open"]["constants"]["C10_Pa"], rows["open"][layer]["C10_change"]
    assert change < -0.05 and C10["total95"][0] < C10["value"] * (1.0 + change)
    assert C10["total95"][0] < groups["stated"]["constants"]["C10_Pa"]["total95"][0]
    sentence = groups["open"]["headline"]
    assert "an estimate" in sentence and "what is assumed (gravity would change it most)" in sentence
    page = identify_page(answer, {}, {})
    # The conclusion is the headline of the page, and its reasons stand below it.
    assert all(part in page for part in groups["stated"]["headline"].split(". ")) and "95 % with what was assumed" in page
    assert identification_tables(answer).renderables


@pytest.mark.parametrize(
    ("noise", "verdict"), [(1.0, "can be used"), (200.0, "is an estimate"), (800.0, "is not known well enough")]
)
def test_the_sentence_says_whether_the_modulus_can_be_used(tmp_path, noise, verdict):
    stretch = np.linspace(1.0, 1.4, 40)
    stress = 1000.0 * (stretch - stretch**-2) + noise * np.random.default_rng(2).standard_normal(40)
    data = write_homogeneous(
        tmp_path / "data", "tension", "stretch,nominal_stress_Pa", stretch, stress, f"stress_sd_Pa = {noise}"
    )
    group = identify(data, law="neo-hooke")["groups"]["all"]
    value, (low, high) = group["shear_modulus"]["value"], group["shear_modulus"]["total95"]
    share = max(value - low, high - value) / value
    limits = {"can be used": (0.0, total.USABLE_SHARE), "is an estimate": (total.USABLE_SHARE, total.ROUGH_SHARE)}
    least, most = limits.get(verdict, (total.ROUGH_SHARE, np.inf))
    assert least < share <= most and verdict in group["headline"]
