"""A law composed from data that no named effect explains."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from explicitfe import close_loop, predict
from explicitfe.inverse.close_loop.discovery.sparse import Regression, sparse


def test_few_columns_are_found_among_many():
    """Two of forty smooth columns made the data of six tests: these two are chosen, and noise alone chooses none."""
    rng = np.random.default_rng(100)
    t = np.linspace(0.0, 1.0, 50)
    tests = np.repeat(np.arange(6), len(t))
    load = np.repeat(rng.uniform(0.5, 2.0, 6), len(t))
    columns = np.column_stack([load ** (k % 4) * np.exp(-np.tile(t, 6) * 0.3 * 2.0 ** (k // 4)) for k in range(40)])
    noise = 0.02 * rng.standard_normal(len(columns))
    unit = np.full(len(columns), 1.0)
    chosen = sparse(Regression(columns, 1.0 * columns[:, 0] + 0.8 * columns[:, 14] + noise, tests, unit, [0]), 8)
    assert chosen[0] == 0 and len(chosen) <= 3
    assert any(k % 4 == 2 and abs(k // 4 - 3) <= 1 for k in chosen), chosen  # its neighbour in time is nearly the same column
    assert sparse(Regression(columns, columns[:, 0] + noise, tests, unit, [0]), 8) == [0]


def relaxing_with_strain(folder: Path) -> None:
    """Ramp and hold at three strains and two rates: small strains do not relax, (I1 - 3)^2 fades in 10 s. Exact quadrature."""
    C10, fading, tau, noise = 500.0, 2500.0, 10.0, 2.0
    rng = np.random.default_rng(101)
    text = (
        'format = "explicitfe-dataset/1"\nname = "fading"\ntitle = "Fading"\ntest = "compression"\n[specimen]\nshape = "point"\n'
    )
    text += f"[noise]\nstress_sd_Pa = {noise}\nstretch_sd = 0.0\n"
    for strain in (0.15, 0.25, 0.35):
        for rate in (0.01, 0.1):
            fine = np.unique(np.concatenate([np.linspace(0.0, strain / rate, 2000), np.linspace(strain / rate, 60.0, 2000)]))
            stretch = 1.0 - np.minimum(rate * fine, strain)
            I1 = stretch**2 + 2.0 / stretch - 3.0
            spring = 2.0 * (stretch - stretch**-2) * 2.0 * fading * I1 / stretch  # true stress over stretch: a material stress
            kept = np.zeros(len(fine))
            for k in range(1, len(fine)):
                x = (fine[k] - fine[k - 1]) / tau
                kept[k] = np.exp(-x) * kept[k - 1] + (spring[k] - spring[k - 1]) * -np.expm1(-x) / x
            stress = 2.0 * (stretch - stretch**-2) * C10 + stretch * kept
            rows = np.unique(np.concatenate([np.linspace(0.0, strain / rate, 15), np.geomspace(strain / rate, 60.0, 20)]))
            measured = np.interp(rows, fine, stress) + noise * rng.standard_normal(len(rows)) * (rows > 0.0)
            name = f"strain-{strain}-rate-{rate}"
            text += (
                f'[[curve]]\nid = "{name}"\nfile = "{name}.csv"\nconditions = {{ max_strain = {strain}, rate_per_s = {rate} }}\n'
            )
            lines = zip(rows, np.interp(rows, fine, stretch), measured, strict=True)
            csv = "".join(f"{a:.9g},{b:.9g},{c:.9g}\n" for a, b, c in lines)
            (folder / f"{name}.csv").write_text(f"time_s,stretch,nominal_stress_Pa\n{csv}", encoding="utf-8")
    (folder / "dataset.toml").write_text(text, encoding="utf-8")


def test_relaxation_that_depends_on_strain_is_written_down(tmp_path):
    """A Prony series relaxes alike at all strains and leaves something; the composed law foretells better and can be run."""
    relaxing_with_strain(tmp_path)
    report = close_loop(tmp_path, out=tmp_path / "out", effects=["viscoelastic", "discovered-law"], processes=1)
    law = report.discovered_law
    assert law is not None, report.sentence
    assert law.cv_nrmse < 0.5 * law.cv_nrmse_before and law.error_holdout < 0.5 * report.final.error.holdout.nrmse
    assert law.instead_of in ([], ["viscoelastic"]) and any(term.tau_s == 10.0 for term in law.terms), law.text
    again = predict(tmp_path, tmp_path / "out" / "discovered.toml")
    held_out = [again.curves[name].nrmse for name in report.split.holdout]
    assert held_out and np.mean(held_out) == pytest.approx(law.error_holdout, rel=1e-6)
