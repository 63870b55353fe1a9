"""Results, checks and lists as tables for people; programs read the same numbers with ``--json``."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rich.console import Group
from rich.markup import escape
from rich.table import Table

_ENERGIES = ("internal_energy", "hourglass_energy", "kinetic_energy", "external_work", "damping_loss")


def listing(title: str, rows: list[dict[str, Any]]) -> Table:
    """A list of what comes with the program. The first column, what a user has to type, is never cut."""
    columns = [column for column in (rows[0] if rows else ()) if column != "source"]
    left_out = rows and "source" in rows[0]
    table = Table(title=title, title_justify="left", caption="sources: add --json" if left_out else None, caption_justify="left")
    for number, column in enumerate(columns):
        table.add_column(column, no_wrap=number == 0, overflow="fold")
    for row in rows:
        table.add_row(*(_text(row[column]) for column in columns))
    return table


def summary(found: dict[str, Any]) -> Table:
    """What a run came to."""
    return _indentation(found) if "curve" in found else _transient(found)


def _indentation(found: dict[str, Any]) -> Table:
    table = _pairs(found["title"])
    table.add_row("status", found["status"])
    table.add_row("mesh", f"{found['hexes']} hexes, {found['nodes']} nodes, {found['copies']:g} times in the whole specimen")
    for load, point in zip(found["loads"], found["curve"], strict=True):
        table.add_row(
            f"{point['force_N']:.4g} N",
            f"{point['displacement_mm']:.4f} mm after {load['iterations']} iterations, residual {load['residual']:.1e}",
        )
    if found["touch_mm"]:
        table.add_row("gravity", f"first touch {found['touch_mm']:.3f} mm below the reference height")
    table.add_row(
        "speed", f"{found['iterations']} iterations in {found['wall_s']:.2f} s (compiling took {found['compile_s']:.1f} s)"
    )
    table.add_row("base reaction", f"within {found['reaction_error']:.1e} of the tool's force")
    table.add_row("penetration", f"{found['penetration_ratio']:.1e} of the indentation at most")
    table.add_row("energy balance", f"off by {found['energy_balance_error']:.1e}: stored against the area under the curve")
    table.add_row("hourglass share", f"{100 * found['hourglass_share']:.1f} % of the elastic energy at most")
    table.add_row("smallest J", f"{found['min_J']:.3f}")
    for path in found.get("plots", []):
        table.add_row("plot", escape(path))
    table.add_row("result", escape(found["result"]))
    return table


def _transient(found: dict[str, Any]) -> Table:
    table = _pairs(found["title"])
    table.add_row("status", found["status"])
    table.add_row("mesh", f"{found['hexes']} hexes, {found['nodes']} nodes")
    table.add_row(
        "steps",
        f"{found['steps']} of {1e6 * found['dt_s']:.1f} µs or longer, at most "
        f"{100 * found['dt_fraction_of_limit']:.0f} % of the stable limit",
    )
    table.add_row(
        "speed",
        f"{1e3 * found['simulated_s']:.1f} ms in {found['wall_s']:.2f} s: "
        f"{found['real_time_factor']:.2g} x real time, the steps alone {found['simulated_s'] / max(found['loop_s'], 1e-9):.2g} x "
        f"(compiling took {found['compile_s']:.1f} s)",
    )
    table.add_row("energy balance", f"off by at most {found['energy_balance_error']:.1e}")
    table.add_row("hourglass share", f"{100 * found['hourglass_share']:.1f} % of the elastic energy at most")
    table.add_row("smallest J", f"{found['min_J']:.3f}")
    table.add_row("at the end", _motion(found))
    for name, probe in found["probes"].items():
        table.add_row(escape(name), f"{_vector_mm(probe['displacement_mm'])} at {probe['speed_mm_s']:.0f} mm/s")
    for path in found.get("plots", []):
        table.add_row("plot", escape(path))
    table.add_row("result", escape(found["result"]))
    return table


def identification(found: dict[str, Any]) -> Group:
    """What ``identify`` returned: constants, curves, what the fit hides, group after group."""
    tables: list[Any] = []
    for name, group in found["groups"].items():
        several = len(found["groups"]) > 1
        title = f"{found['title']}: {name}" if several else found["title"]
        if "constants" not in group:
            failed = _pairs(title)
            failed.add_row("[red]failed[/red]", escape(group["message"]))
            tables.append(failed)
            continue
        tables.append(_constants(title, found, group))
        tables.append(_curves(group))
        if group["hides"]:
            tables.append(_hides(group))
    end = _pairs("")
    end.add_row("forward runs", f"{found['forward_runs']}, {found['wall_s']:.1f} s in all")
    for path in found["files"]:
        end.add_row("file", escape(path))
    return Group(*tables, end)


def identification_notes(found: dict[str, Any]) -> Iterator[str]:
    """What a reader must know, sentence by sentence."""
    several = len(found["groups"]) > 1
    for name, group in found["groups"].items():
        for warning in group["warnings"]:
            yield f"{name}: {warning}" if several else warning
    yield from found["warnings"]


def _constants(title: str, found: dict[str, Any], group: dict[str, Any]) -> Table:
    table = _pairs(title)
    for name, entry in group["constants"].items():
        text = f"{entry['value']:.5g} Pa"
        if "ci95" in entry:
            low, high = entry["ci95"]
            by_curvature = " to ".join(f"{limit:.5g}" for limit in entry["ci95_curvature"])
            text += f"  (95 %: {low:.5g} to {_number(high)}, by curvature {by_curvature})"
        if name in group["at_bound"]:
            text += "  [yellow]at its bound[/yellow]"
        table.add_row(name.removesuffix("_Pa"), text)
    if group["correlation"] is not None:
        table.add_row("correlation", f"{group['correlation']:+.2f}")
    unit = group["unit"]
    noise = f"{group['noise_sd']:.2g} {unit} ({group['noise']}); numerical {group['numerical_sd']:.2g} {unit}"
    table.add_row("noise", noise)
    if group["chi2"] is not None:
        table.add_row("χ²", f"{group['chi2']:.4g} with {group['degrees_of_freedom']} degrees of freedom")
    if "paper" in group:
        paper = group["paper"]
        table.add_row(
            "paper's method",
            f"{group['status']} in {len(paper['trace'])} runs "
            f"(α {1e3 * paper['alpha_mm']:g} µm, β {1e3 * paper['beta_mm']:g} µm)",
        )
        table.add_row(
            "verdict",
            f"{sum(paper['within'])} of {len(paper['within'])} points within {paper['tolerance']}; "
            f"largest error {100.0 * paper['largest_relative_error']:.2g} %",
        )
    table.add_row("assumed", escape(", ".join(group["assumed"])))
    return table


def _curves(group: dict[str, Any]) -> Table:
    table = Table(title="curves", title_justify="left")
    table.add_column("curve", no_wrap=True)
    for head in ("", "rows", "rmse", "of the largest value", "largest error"):
        table.add_column(head, justify="right" if head else "left")
    for name, row in group["curves"].items():
        left = f" (+{row['rows_left_out']} not used)" if row["rows_left_out"] else ""
        table.add_row(
            escape(name),
            "fitted" if row["split"] == "fit" else "predicted",
            f"{row['rows']}{left}",
            f"{row['rmse']:.3g} {row['unit']}",
            f"{100.0 * row['nrmse']:.2f} %",
            f"{row['largest_error']:.3g} {row['unit']}",
        )
    return table


def _hides(group: dict[str, Any]) -> Table:
    table = Table(
        title="what the fit hides: with this instead of what was assumed, the same data would give",
        title_justify="left",
        caption="left: rms of the residual by which it could be told",
        caption_justify="left",
    )
    table.add_column("if")
    for head in ("C10", "C20", "left", "in noise"):
        table.add_column(head, justify="right", no_wrap=True)
    for row in group["hides"]:
        if "problem" in row:
            table.add_row(escape(row["if"]), escape(row["problem"]), "", "", "")
            continue
        left = f"{1e3 * row['left']:.2g} µm" if group["unit"] == "mm" else f"{row['left']:.2g} {group['unit']}"
        changes = (f"{100.0 * row[f'{name}_change']:+.1f} %" for name in ("C10", "C20"))
        table.add_row(escape(row["if"]), *changes, left, f"{row['left_in_noise']:.2g}")
    return table


def _number(value: float) -> str:
    return f"{value:.5g}" if value < float("inf") else "no limit"


def prediction(found: dict[str, Any]) -> Table:
    """How far a model is from measured curves."""
    effects = ", ".join(found["effects"]) or "elastic"
    table = Table(title=escape(f"{found['dataset']}: {effects}"), title_justify="left")
    table.add_column("curve", no_wrap=True)
    for column in ("", "rmse", "of the largest", "time"):
        table.add_column(column, justify="right")
    for name, row in found["curves"].items():
        if row["status"] != "predicted":
            table.add_row(escape(name), "[red]failed[/red]", "", "", "")
            continue
        share = "" if row["nrmse"] is None else f"{100 * row['nrmse']:.2f} %"
        table.add_row(escape(name), row["split"] or "", f"{row['rmse']:.4g} {row['unit']}", share, f"{row['seconds']:.2f} s")
    return table


def check(title: str, found: dict[str, Any]) -> Table:
    """What is known of a scenario before it runs."""
    table = _pairs(title)
    table.add_row("model", escape(found["name"]))
    table.add_row(
        "mesh",
        f"{found['hexes']} hexes, {found['nodes']} nodes, {found['fixed_nodes']} of them held; "
        f"{1e-3 * found['volume_mm3']:.4g} cm³, {found['mass_g']:.4g} g",
    )
    table.add_row("edges", f"{found['smallest_edge_mm']:.3g} to {found['largest_edge_mm']:.3g} mm")
    table.add_row("worst element", f"{found['worst_element']}, scaled Jacobian {found['smallest_scaled_jacobian']:.3g}")
    for row in _physics(found):
        table.add_row(*row)
    if "predicted_iterations" in found:
        table.add_row(
            "prediction",
            f"{found['predicted_iterations']} iterations in about {found['predicted_wall_s']:.2g} s for {found['loads']} loads",
        )
        table.add_row("size", f"{found['kernel_memory_MB']:.3g} MB in memory, {found['result_size_MB']:.3g} MB in the result")
        return table
    table.add_row("probes", escape(", ".join(found["probes"])) or "none")
    table.add_row(
        "step",
        f"{found['step_us']:.4g} µs, {'stable' if found['stable'] else '[red]unstable[/red]'}: the limit is "
        f"{found['stable_step_us']:.4g} µs\n"
        f"(at least {found['stable_step_bound_us']:.4g} µs, by element {found['limiting_element']})",
    )
    table.add_row(
        "prediction", f"{found['predicted_steps']} steps in {found['predicted_wall_s']:.2g} s if the step stays as it is"
    )
    table.add_row("size", f"{found['kernel_memory_MB']:.3g} MB in memory, {found['result_size_MB']:.3g} MB in the result")
    return table


def warm(found: dict[str, float]) -> Table:
    """What machine code was made for, and how long it took."""
    table = Table(title="machine code", title_justify="left")
    table.add_column("for", no_wrap=True)
    table.add_column("seconds", justify="right")
    for name, seconds in found.items():
        table.add_row(name, f"{seconds:.1f}")
    return table


def bench(found: dict[str, Any]) -> Group:
    """How fast this machine is."""
    lanes = f"{found['lanes']} lanes, {found['cores']} cores"
    table = Table(title=f"ns per element and step, float64, {lanes}", title_justify="left")
    threads = max((row["threads"] or 1 for row in found["rows"]), default=1)
    for column in ("hexes", "element", "1 thread", "documented", "ratio", f"{threads} threads", "faster"):
        table.add_column(column, justify="left" if column == "element" else "right", no_wrap=True)
    for row in found["rows"]:
        known, shared = row["reference_ns"], row["ns_threads"]
        table.add_row(
            str(row["elements"]),
            row["element"],
            f"{row['ns']:.1f}",
            "" if known is None else f"{known:.0f}",
            "" if known is None else f"{row['ns'] / known:.2f}",
            "" if shared is None else f"{shared:.1f}",
            "" if shared is None else f"{row['ns'] / shared:.2f}",
        )
    spoken = found["scenario"]
    line = (
        f"{spoken['name']}: {spoken['hexes']} hexes, {spoken['steps']} steps in {1e3 * spoken['loop_s']:.0f} ms of the loop, "
        f"{spoken['real_time_factor']:.2f} times as fast as it is spoken"
    )
    return Group(table, line)


def result(found: dict[str, Any]) -> Table:
    """What a result file holds."""
    table = _pairs(found["path"])
    run, last = found["summary"], found["last"]
    state = found["status"]
    if state == "running":
        state += " (it goes on now)" if found["live"] else " (it was killed)"
    table.add_row("status", escape(f"{state}: {found['message']}" if found["message"] else state))
    table.add_row("title", escape(found["model"].get("scenario", {}).get("title", "")))
    table.add_row("mesh", f"{found['elements']} hexes, {found['nodes']} nodes")
    table.add_row("node sets", escape(", ".join(f"{name} ({count})" for name, count in found["node_sets"].items())) or "none")
    for row in _physics(found["model"]):
        table.add_row(*row)
    table.add_row("times", _times(found))
    table.add_row("fields", escape(", ".join(f"{field['name']} ({field['unit']})" for field in found["fields"])))
    energies = [f"{_words(name)} {1e3 * last[name]:.4g} mJ" for name in _ENERGIES if name in last]
    if energies:
        table.add_row("last energies", "\n".join(energies))
    if "balance_error" in last:
        table.add_row("energy balance", f"off by at most {last['balance_error']:.1e}")
    if run:
        table.add_row("hourglass share", f"{100 * run['hourglass_share']:.1f} % of the elastic energy at most")
        if "curve" in run:
            points = [f"{point['force_N']:.4g} N at {point['displacement_mm']:.4f} mm" for point in run["curve"]]
            table.add_row("loads", "\n".join(points) or "none")
        else:
            table.add_row("at the end", _motion(run))
    for name in found["model"].get("probes", {}):
        if f"probe_{name}_displacement" in last:
            table.add_row(escape(name), _vector_mm([1e3 * x for x in last[f"probe_{name}_displacement"]]))
    made = found["provenance"]
    packages = ", ".join(f"{name} {made[name]}" for name in ("explicitfe", "python", "numpy", "numba", "h5py") if made.get(name))
    rows = [packages, made.get("commit") and f"commit {made['commit']}", made.get("processor"), made.get("started_utc")]
    table.add_row("made by", escape("\n".join(row for row in rows if row)))
    table.add_row("scenario", f"sha256 {found['scenario_sha256'][:16]}…")
    return table


def _pairs(title: str) -> Table:
    table = Table(title=escape(title), title_justify="left", show_header=False)
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    return table


def _physics(model: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Rows on tissue, damping and muscles."""
    if "material" in model:
        material = {key: value for key, value in model["material"].items() if key != "source"}
        yield "material", f"{escape(material.pop('law'))}: {_text(material)}"
    if "tool" in model:
        yield "tool", _text(model["tool"])
    if "alpha_per_s" in model:
        yield "damping", f"{model['alpha_per_s']:g} 1/s"
    if "muscles" in model:
        yield "muscles", escape("\n".join(_muscle(muscle) for muscle in model["muscles"])) or "none"


def _muscle(muscle: dict[str, Any]) -> str:
    if muscle["profile"] == "table":
        course = f"table of {len(muscle['table'])} pairs"
    else:
        course = f"{muscle['profile']} from {muscle['start_ms']:g} ms"
        course += f" in {muscle['rise_ms']:g} ms" if muscle["rise_ms"] else ""
        course += f" to {muscle['end_ms']:g} ms" if muscle["end_ms"] is not None else ""
    how = f"{muscle['distribution']}, {muscle['direction']}" + ("" if muscle["side"] == "both" else f", {muscle['side']} side")
    return f"{muscle['name']} {muscle['force_N']:g} N: {course}; {how}"


def _times(found: dict[str, Any]) -> str:
    if not found["steps"]:
        return "no sample"
    if "curve" in found["summary"]:
        return f"{found['steps']} equilibria, {found['time_s'][0]:.4g} to {found['time_s'][1]:.4g} s"
    first, last = (1e3 * time for time in found["time_s"])
    text = f"{found['steps']} sample{'s' if found['steps'] > 1 else ''}, {first:.4g} to {last:.4g} ms"
    return text if found["every_s"] is None else f"{text}, every {1e3 * found['every_s']:.3g} ms"


def _motion(run: dict[str, Any]) -> str:
    if run["settled"] and run["largest_speed_mm_s"] == 0.0:
        return "at rest"
    return f"{'settled' if run['settled'] else 'still moving'}, fastest node {run['largest_speed_mm_s']:.0f} mm/s"


def _vector_mm(vector: list[float]) -> str:
    x, y, z = vector
    return f"({x:+.2f}, {y:+.2f}, {z:+.2f}) mm"


def _words(name: str) -> str:
    return name.replace("_", " ")


def _text(value: Any) -> str:
    """Numbers in short, and a table of constants as 'C10 191.5 Pa, b 2': the unit stands at the end of the key."""
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, dict):
        own_first = sorted(value, key=lambda key: key in ("poisson", "density_kg_m3"))
        return ", ".join(_quantity(key, value[key]) for key in own_first)
    if isinstance(value, list | tuple):
        return ", ".join(_text(inner) for inner in value)
    return escape(str(value))


def _quantity(key: str, value: Any) -> str:
    for ending, unit in (("_Pa", "Pa"), ("_kg_m3", "kg/m³"), ("_mm", "mm")):
        if key.endswith(ending):
            return f"{escape(key.removesuffix(ending))} {_text(value)} {unit}"
    return f"{escape(key)} {_text(value)}"


def loop(found: dict[str, Any]) -> Group:
    """What ``close-loop`` found: the verdict, errors before and after, candidates."""
    head = _pairs(found["title"])
    head.add_row("verdict", f"[bold]{escape(found['verdict'])}[/bold], what is left: {found['remainder']}")
    head.add_row("", escape(found["sentence"]))
    if found["remainder_where"]:
        head.add_row("", escape(found["remainder_where"]))
    if found["verdict"] == "failed":
        return Group(head)
    for side, words in (("holdout", "held-out curves"), ("fit", "fitted curves")):
        before, after = found["baseline"]["error"][side], found["final"]["error"][side]
        if before and after:
            text = f"{100 * before['nrmse']:.2f} % of the largest value before, {100 * after['nrmse']:.2f} % after"
            head.add_row(f"error, {words}", text)
    for name, value in found["final"]["parameters"].items():
        for group, entry in value.items() if "value" not in value else [("", value)]:
            low, high = entry["ci95"]
            label = f"{name} {group}" if group not in ("", "all") else name
            head.add_row(escape(label), f"{entry['value']:.4g} ({low:.4g} to {high:.4g})")
    tables: list[Any] = [head]
    for number, step in enumerate(found["steps"], 1):
        table = Table(title=f"step {number}: what would explain the rest", title_justify="left")
        for column in ("effect", "status", "chi² drop", "p (Holm)", "cross-validated error"):
            table.add_column(column, no_wrap=column == "effect")
        shown = [row for row in step["candidates"] if row["status"] in ("significant", "not-significant", "failed")]
        for row in shown:
            chosen = " (added)" if row["effect"] == step["chosen"] else ""
            drop = row["chi2_drop"] if row["chi2_drop_refitted"] is None else row["chi2_drop_refitted"]
            error = "" if row["cv_nrmse"] is None else f"{100 * row['cv_nrmse']:.2f} %"
            table.add_row(row["effect"] + chosen, row["status"], f"{drop:.1f}", f"{row['p_holm']:.2g}", error)
        if shown:
            tables.append(table)
    end = _pairs("")
    if found["next_experiment"]:
        entry = found["next_experiment"]
        text = f"{entry['protocol']}: tells {' from '.join(entry['separates'])} ({entry['separation']:.3g}, 25 is enough)"
        end.add_row("measure next", escape(text))
    for path in found.get("files", []):
        end.add_row("file", escape(path))
    return Group(*tables, end)


def design(found: dict[str, Any]) -> Table:
    """What a planned test can find and tell apart."""
    table = Table(title=found["protocol"], title_justify="left")
    for column in ("effect", "smallest that shows", "largest plausible", "hides in", "cannot be told from"):
        table.add_column(column, no_wrap=column == "effect", overflow="fold")
    for row in found["effects"]:
        if not row["shows"]:
            table.add_row(row["effect"], "no", "", escape(row["reason"]), "")
            continue
        hides = ", ".join(f"{name.removesuffix('_Pa')} {100 * share:+.0f} %" for name, share in row["hides_in"].items())
        smallest = "-" if row["smallest"] is None else f"{row['smallest']:.3g}"
        rivals = ", ".join(row["cannot_tell_from"]) or f"(nearest: {row['nearest']}, {row['separation']:.3g})"
        table.add_row(f"{row['effect']}", smallest, f"{row['largest_plausible']:.3g}", hides, rivals)
    return table
