"""Rivals from sparse regression on the same response columns: LASSO, LARS, orthogonal matching pursuit, and greedy selection.

    python rivals.py SET --out answers/

The size of each model is chosen by AIC, BIC or cross-validation over tests. Its coefficients are refitted by least squares
on the selected columns. C10 and C20 belong to every model. "greedy-refit" fits the nonlinear model after each step and stops by
BIC. Coefficients are not negative, because a response of the other sign is a column of its own. No rival states a probability.

LARS: Efron, Hastie, Johnstone & Tibshirani (2004) Ann. Stat. 32:407-499. OMP: Pati, Rezaiifar & Krishnaprasad (1993).
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from library import Data, Library
from scipy.optimize import nnls

from explicitfe.platform.errors import InputError, RunError
from explicitfe.results.files.folder import whole_file

MOST_COLUMNS = 8  # of a model
FOLDS_OF_ONE_TEST = 5  # blocks of rows, where a dataset has one test
DEPENDENT = 1e-8  # a column with a smaller share outside of those selected is none
MOST_EFFECTS = 3  # of greedy-refit
REFITTED_CANDIDATES = 3  # of each step of it
Supports = list[list[int]]  # columns of each step of a method, from none on


# ---- the methods: each gives a path of supports ----


def omp(X: np.ndarray, y: np.ndarray) -> Supports:
    """Orthogonal matching pursuit: the column with the largest correlation with the residual is added."""
    return _forward(X, y, lambda Z, r: Z.T @ r)


def greedy(X: np.ndarray, y: np.ndarray) -> Supports:
    """Forward selection: the column that lowers the sum of squares most is added."""
    return _forward(X, y, None)


def _forward(X: np.ndarray, y: np.ndarray, score: Callable[[np.ndarray, np.ndarray], np.ndarray] | None) -> Supports:
    Z = X / np.maximum(np.linalg.norm(X, axis=0), 1e-300)
    path: Supports = [[]]
    Q = np.zeros((len(y), 0))
    r = y.copy()
    for _ in range(min(MOST_COLUMNS, X.shape[1])):
        apart = Z - Q @ (Q.T @ Z)
        size = np.linalg.norm(apart, axis=0)
        free = size**2 > DEPENDENT
        free[path[-1]] = False
        if not free.any():
            break
        value = score(Z, r) if score is not None else apart.T @ r / np.maximum(size, 1e-300)
        free &= value > 0.0
        if not free.any():
            break
        best = int(np.argmax(np.where(free, value, -1.0)))
        path.append([*path[-1], best])
        Q = np.column_stack([Q, apart[:, best] / size[best]])
        r = y - Q @ (Q.T @ y)
    return path


def lars(X: np.ndarray, y: np.ndarray) -> Supports:
    """Least angle regression."""
    return _angles(X, y, lasso=False)


def lasso(X: np.ndarray, y: np.ndarray) -> Supports:
    """LASSO, by the path of LARS with columns that leave where their coefficient becomes zero."""
    return _angles(X, y, lasso=True)


def _angles(X: np.ndarray, y: np.ndarray, *, lasso: bool) -> Supports:
    Z = X / np.maximum(np.linalg.norm(X, axis=0), 1e-300)
    m = Z.shape[1]
    coefficients, fitted = np.zeros(m), np.zeros(len(y))
    active: list[int] = []
    barred = np.zeros(m, dtype=bool)  # columns that depend on the active ones
    path: Supports = [[]]
    dropped = False  # a column has left in the last step, so none enters in this one
    for _ in range(4 * MOST_COLUMNS):
        c = Z.T @ (y - fitted)
        out = np.ones(m, dtype=bool)
        out[active] = False
        out &= ~barred
        if not dropped:
            if not out.any():
                break
            new = int(np.argmax(np.where(out, c, -np.inf)))
            if c[new] <= 0.0:
                break
            if _dependent(Z, active, new):
                barred[new] = True
                continue
            active.append(new)
            out[new] = False
        top = float(c[active].max())
        if top < 1e-12 or len(active) > MOST_COLUMNS:
            break
        A = Z[:, active]
        w = np.linalg.solve(A.T @ A, np.ones(len(active)))
        scale = 1.0 / np.sqrt(w.sum())
        direction = A @ (scale * w)
        a = Z.T @ direction
        with np.errstate(divide="ignore", invalid="ignore"):
            steps = np.concatenate([((top - c) / (scale - a))[out], [top / scale]])
        gamma = float(np.min(steps[(steps > 1e-12) & np.isfinite(steps)], initial=top / scale))
        change = scale * w
        leaving = -1
        if lasso:
            with np.errstate(divide="ignore", invalid="ignore"):
                zero = -coefficients[active] / change
            crossing = [k for k in range(len(active)) if 1e-12 < zero[k] < gamma]
            if crossing:
                leaving = min(crossing, key=lambda k: zero[k])
                gamma = float(zero[leaving])
        coefficients[active] += gamma * change
        fitted = fitted + gamma * direction
        if leaving >= 0:
            coefficients[active[leaving]] = 0.0
            del active[leaving]
        dropped = leaving >= 0
        path.append(list(active))
    return path


def _dependent(Z: np.ndarray, active: list[int], new: int) -> bool:
    if not active:
        return False
    rest = Z[:, new] - Z[:, active] @ np.linalg.lstsq(Z[:, active], Z[:, new], rcond=None)[0]
    return float(rest @ rest) < DEPENDENT


METHODS: dict[str, Callable[[np.ndarray, np.ndarray], Supports]] = {"lasso": lasso, "lars": lars, "omp": omp, "greedy": greedy}


# ---- the size of a model ----


def chi2_of(library: Library, support: list[int]) -> float:
    """Sum of squares of the fit by the constants and some columns."""
    C, x = _refitted(library.constants, library.X[:, support], library.y)
    rest = library.y - library.constants @ C - library.X[:, support] @ x
    return float(rest @ rest)


def _refitted(C: np.ndarray, X: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients of the constants, and those of the columns, which are not negative."""
    rest = outside_constants(C, X)
    size = np.maximum(np.linalg.norm(rest, axis=0), 1e-300)
    x = nnls(rest / size, outside_constants(C, y))[0] / size if X.shape[1] else np.zeros(0)
    return np.linalg.lstsq(C, y - X @ x, rcond=None)[0], x


def by_criterion(library: Library, path: Supports, cost: float) -> list[int]:
    """The support with the least chi2 + cost per column: 2 is AIC, log(n) BIC."""
    return min(path, key=lambda support: chi2_of(library, support) + cost * len(support))


def outside_constants(constants: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """The part of columns (n,) or (n, m) that the constants cannot take up."""
    Q, _ = np.linalg.qr(constants)
    return columns - Q @ (Q.T @ columns)


def by_cross_validation(library: Library, method: Callable[[np.ndarray, np.ndarray], Supports], path: Supports) -> list[int]:
    """The support of the step that predicts tests left out in turn best."""
    folds = library.test
    if len(np.unique(folds)) < 2:
        folds = np.arange(len(library.y)) * FOLDS_OF_ONE_TEST // len(library.y)
    errors = np.zeros(len(path))
    for fold in np.unique(folds):
        fit, held = folds != fold, folds == fold
        C, X, y = library.constants, library.X, library.y
        steps = method(outside_constants(C[fit], X[fit]), outside_constants(C[fit], y[fit]))
        for k in range(len(path)):
            support = steps[min(k, len(steps) - 1)]
            b, x = _refitted(C[fit], X[fit][:, support], y[fit])
            errors[k] += float(np.sum((y[held] - C[held] @ b - X[held][:, support] @ x) ** 2))
    return path[int(np.argmin(errors))]


def supports(library: Library) -> dict[str, list[int]]:
    """Method and criterion -> columns that are selected."""
    X, y = (outside_constants(library.constants, part) for part in (library.X, library.y))
    found = {}
    for name, method in METHODS.items():
        path = method(X, y) if X.shape[1] else [[]]
        found[f"{name}-aic"] = by_criterion(library, path, 2.0)
        found[f"{name}-bic"] = by_criterion(library, path, float(np.log(len(y))))
        found[f"{name}-cv"] = by_cross_validation(library, method, path) if X.shape[1] else []
    return found


def greedy_refit(data: Data, library: Library) -> list[str]:
    """Effects by forward selection with a nonlinear fit at each step; stops where BIC falls with none of the best."""
    fit, effects = data.elastic, list[str]()
    cost = float(np.log(len(library.y)))
    while len(effects) < MOST_EFFECTS:
        X, y = outside_constants(fit.jacobian, library.X), outside_constants(fit.jacobian, fit.residual)
        gains = X.T @ y / np.maximum(np.linalg.norm(X, axis=0), 1e-300)
        best: dict[str, int] = {}  # effect -> its column with the largest decrease of chi2
        for k in np.argsort(-gains):
            name = library.columns[k].effect
            if gains[k] > 0.0 and name not in effects and len(best) < REFITTED_CANDIDATES:
                best.setdefault(name, int(k))
        for name, k in best.items():
            new = data.fitted(fit, library.columns[k])
            if new is not None and fit.chi2 - new.chi2 > cost * len(library.columns[k].values):
                fit, effects = new, [*effects, name]
                break
        else:
            break
    return effects


# ---- answers ----


def answers_to(case: Path) -> dict[str, dict[str, Any]]:
    """Rival -> its answer to a case."""
    begin = time.perf_counter()
    try:
        with Data(case) as data:
            library = data.library()
            shared = time.perf_counter() - begin
            causes = {name: {library.columns[k].cause for k in support} for name, support in supports(library).items()}
            linear = time.perf_counter() - begin
            effects = greedy_refit(data, library)
            refitted = time.perf_counter() - begin - linear + shared
    except (InputError, RunError) as error:
        names = [f"{method}-{by}" for method in METHODS for by in ("aic", "bic", "cv")] + ["greedy-refit"]
        return {name: {"verdict": "failed", "message": str(error)} for name in names}
    answers = {name: _answer(found, linear) for name, found in causes.items()}
    answers["greedy-refit"] = _answer(set(effects), refitted)
    return answers


def _answer(names: set[str], seconds: float) -> dict[str, Any]:
    return {"verdict": "effect-found" if names else "no-missing-effect", "causes": sorted(names), "seconds": round(seconds, 2)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("set", type=Path)
    parser.add_argument("--out", type=Path, required=True, help="folder for one file of answers for each rival")
    parser.add_argument("--limit", type=int, default=None, help="largest number of cases")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    entries: dict[str, dict[str, Any]] = {}
    for path in options.out.glob("*.json"):
        entries[path.stem] = json.loads(path.read_text(encoding="utf-8"))
    done = set.intersection(*(set(entry["cases"]) for entry in entries.values())) if entries else set()
    cases = sorted(path.parent for path in options.set.glob("case-*/dataset.toml"))[: options.limit]
    for number, case in enumerate(cases):
        if case.name in done:
            continue
        for name, answer in answers_to(case).items():
            entry = entries.setdefault(name, {"program": name, "cases": {}})
            entry["cases"][case.name] = answer
            whole_file(options.out / f"{name}.json", json.dumps(entry, indent=1) + "\n")
        print(f"\r{number + 1} of {len(cases)} cases", end="", flush=True)
    print()


if __name__ == "__main__":
    main()
