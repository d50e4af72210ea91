"""The part of the head report on the sentences of the paper: where each is tested, and the result.

Statements are those of sections 4 and 5.1, and those of sections 3.2 and 6 on which they rest.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from string import Formatter
from typing import Any, TypeAlias

from minorloop.report import Report, Table
from papers.claims import cell, figure

Comparison: TypeAlias = Callable[[Mapping[str, Any]], bool]
Verdict: TypeAlias = "str | Comparison | tuple[Comparison, ...]"
"""Whether a statement holds: as the tests say, or by the figures of this run. Of several
comparisons, it holds in part if some do."""


def _least(first: str | float, *others: str | float) -> Comparison:
    """Compare whether the first figure or number is no larger than each of the others."""

    def value(known: Mapping[str, Any], of: str | float) -> float:
        return float(figure(known, of)) if isinstance(of, str) else of

    return lambda known: all(value(known, first) <= value(known, one) for one in others)


def _four(key: str, digits: str) -> str:
    """Return the places of a figure of the paper's rivals, of its own control, and of ours."""
    names = ("feedforward_pi", "model_reference", "internal_model", "observer")
    return ", ".join(f"{{rivals.{name}.{key}:{digits}}}" for name in names)


STATEMENTS: tuple[tuple[str, str, str, str, Verdict], ...] = (
    (
        "3.2, Eqs. (5), (6)",
        "The output is a sum over the stored extrema, one for rising and one for falling inputs",
        "test_equals_the_sum_of_areas_cell_by_cell in minorloop/tests/operators/test_preisach.py",
        "right with the last terms that are given above, not as printed",
        "holds, with corrected last terms",
    ),
    (
        "3.2, Eqs. (7), (8)",
        "Between the points of the mesh the output is interpolated, in squares and in triangles",
        "section on Figs 2 and 5; test_the_model_is_recovered_from_its_reversal_values in "
        "minorloop/tests/operators/test_preisach.py",
        "{static.mesh_rms_deg:.2f} degrees rms at random holds, {static.dots_rms_deg:.2f} without",
        _least("static.mesh_rms_deg", "static.dots_rms_deg"),
    ),
    (
        "3.2, Fig 5",
        "The model agrees with the wire under an arbitrary input",
        "section on Figs 2 and 5",
        "{arbitrary.mesh_rms_deg:.2f} degrees rms for the mesh behind a linear lag, "
        "{arbitrary.rms_deg:.2f} for the operator on power; while the wire moves, "
        "{arbitrary.mesh_moving_rms_deg:.2f} and {arbitrary.moving_rms_deg:.2f}",
        (
            _least("arbitrary.mesh_rms_deg", 1.5),
            _least("arbitrary.rms_deg", 1.5),
            _least("arbitrary.moving_rms_deg", 1.5),
        ),
    ),
    (
        "4.1",
        "Controllers that use the model of the hysteresis make the angle more accurate",
        "section on Fig 10",
        "settling of steps in s: observer {steps.settle_s:.1f}, PI alone "
        "{rivals.pi.settle_s:.1f}; steady rms in degrees: {steps.steady_rms_deg:.2f} and "
        "{rivals.pi.steady_rms_deg:.2f}",
        _least("steps.settle_s", "rivals.pi.settle_s"),
    ),
    (
        "4.1, Fig 6",
        "The inverse steps the voltage up for a rising target and down for a falling one",
        "section on Fig 6; test_the_stepping_inverse_passes_each_target_by_less_than_a_step in "
        "papers/tests/catheter/test_head_ramps.py",
        "errs by {stepping_inverse.rms_pct:.1f} % of the range rms on its own model, with steps "
        "of 0.1 V",
        "holds",
    ),
    (
        "4.1, Fig 6",
        "An unchanged target leaves the voltage unchanged",
        "test_an_unchanged_target_leaves_the_input in papers/tests/catheter/test_head_ramps.py",
        "the same for the stepping and the exact inverse; the chart of Fig 6 does not do it",
        "holds; not in the chart",
    ),
    (
        "4.1, Fig 7",
        "The inverse of a linear heating before that of the operator compensates in open loop",
        "section on Fig 8",
        "two ramps in closed loop are {fig8.closed_deg:.2f} degrees rms off, the first in open "
        "loop {fig8.error_first_ramp_deg:.2f}",
        "holds in part",
    ),
    (
        "4.1, Fig 8",
        "The first rising ramp is followed",
        "section on Fig 8",
        "{fig8.first_rise_deg:.2f} degrees rms, with the start from cold",
        _least("fig8.first_rise_deg", 1.5),
    ),
    (
        "4.1, Fig 8",
        "After a long operation a significant error is left; the heating varies",
        "section on Fig 8",
        "{fig8.error_last_ramp_deg:.2f} degrees rms in the tenth ramp, {fig8.ratio:.1f} times the "
        "first, if the body of the head warms by {fig8.body_K:.1f} K; "
        "{fig8.constant.ratio:.1f} times without convection and body",
        _least(1.5, "fig8.ratio"),
    ),
    (
        "4.2, Eq. (9)",
        "The image Jacobian of pan and tilt",
        "test_pan_and_tilt_move_a_point_of_the_wall_as_finite_differences_say and "
        "test_an_untilted_head_without_a_lever_is_the_two_columns_of_the_camera in "
        "minorloop-head/tests/vision/test_jacobian.py",
        "right for an untilted head; with tilt and lever it has more terms, which are used",
        "holds, with more terms",
    ),
    (
        "4.2, Eq. (10)",
        "The control law brings the point to the middle of the picture at the gain lambda",
        "test_the_error_decays_at_the_gain in minorloop-head/tests/vision/test_servo.py; "
        "python -m papers "
        "inspection",
        "seconds from 43 to 2 px of 320 by the camera alone: {integral.settle_s:.1f}",
        "holds",
    ),
    (
        "4.2, Eq. (10)",
        "Its integral attenuates tracking errors",
        "section on Eq. (10)",
        "{integral.sway_ratio:.2f} of the sway is left that is left without it; with the printed "
        "sign the point is {integral.printed_px:.0f} px of 320 off after 8 s",
        _least("integral.sway_ratio", 0.8),
    ),
    (
        "4.3",
        "Feedforward with PI (ref. 11) and a model reference (ref. 12) apply poorly where "
        "conditions vary; an internal model is more robust",
        "section on Fig 10",
        "inverse and PI, model reference, internal model, observer: settling when disturbed, "
        f"{_four('disturbed_settle_s', '.1f')} s; at worst while the ambient rises by 10 K, "
        f"{_four('ambient_ramp_max_deg', '.2f')} degrees; circle of 30 s, "
        f"{_four('circle_rms_deg', '.2f')} degrees rms",
        tuple(
            _least(
                f"rivals.internal_model.{key}",
                f"rivals.feedforward_pi.{key}",
                f"rivals.model_reference.{key}",
            )
            for key in ("disturbed_settle_s", "ambient_ramp_max_deg", "circle_rms_deg")
        ),
    ),
    (
        "4.3, Fig 9",
        "H(s) is the ideal transfer function from the input of the inverse to the angle",
        "test_the_lag_of_the_model_is_that_of_the_wire_with_its_latent_heat and "
        "test_an_exact_model_leaves_nothing_to_feed_back in "
        "minorloop-head/tests/control/test_internal_model.py",
        "a lag and the delay of the readings; on the simulated wire the heat precedes the "
        "operator, so that no H(s) behind it is exact",
        "holds in part",
    ),
    (
        "4.3, Fig 9",
        "G(s), a slow pole, compensates the phase lag of the plant",
        "not tested: a pole adds phase lag. In its place C(s) has the inverse of the lag of H(s)",
        "-",
        "not tested",
    ),
    (
        "4.3, Fig 9",
        "Adjusting C(s) guarantees that the loop is stable",
        "test_margins_are_edges and "
        "test_a_wire_is_stable_up_to_the_predicted_delay_and_not_far_beyond in "
        "minorloop-head/tests/control/test_robustness.py",
        "stable to a delay of the sensor of {robust.predicted_edge:.2f} s as predicted, to "
        "{robust.measured_edge:.2f} s as found; predicted up to {robust.gain:.1f} times the gain "
        "of its model, and down to {robust.lag:.2f} times the lag",
        _least("robust.predicted_edge", "robust.measured_edge"),
    ),
    (
        "4.3",
        "The internal model is robust against perturbations",
        "section on Fig 10",
        "at worst {rivals.internal_model.ambient_ramp_max_deg:.2f} degrees off while the ambient "
        "rises by 10 K, PI alone {rivals.pi.ambient_ramp_max_deg:.2f}, observer "
        "{rivals.observer.ambient_ramp_max_deg:.2f}",
        _least("rivals.internal_model.ambient_ramp_max_deg", "rivals.pi.ambient_ramp_max_deg"),
    ),
    (
        "4.3, Fig 10",
        "With the inverse the closed loop is nearly linear: steps of different size are alike",
        "section on Fig 10, the specimen that is drawn",
        "settling of the quickest and the slowest step in s: observer {drawn.observer.least:.1f} "
        "and {drawn.observer.most:.1f}, internal model {drawn.internal_model.least:.1f} and "
        "{drawn.internal_model.most:.1f}, PI alone {drawn.pi.least:.1f} and {drawn.pi.most:.1f}",
        lambda known: known["drawn"]["observer"]["most"] <= 2 * known["drawn"]["observer"]["least"],
    ),
    (
        "4.3, Fig 11",
        "A circle of both axes is followed by vision",
        "section on Fig 11, circles on the wall",
        "{camera.circle_60s.rms_mm:.2f} mm rms in 60 s, {camera.circle_30s.rms_mm:.2f} in 30 s; "
        "{camera.circle_paper.rms_mm:.2f} on one of the paper's size",
        _least("camera.circle_60s.rms_mm", 0.25),
    ),
    (
        "4.3",
        "Identification off line reduces the computation in the loop",
        "section What was found; the specimen that is drawn, where adaptive identifies in the loop",
        "{realtime.step_ms_median:.2f} ms a step, of 40 ms; observer "
        "{drawn.observer.step_ms:.2f}, adaptive {drawn.adaptive.step_ms:.2f} ms in steps of Fig 10",
        _least("drawn.observer.step_ms", "drawn.adaptive.step_ms"),
    ),
    (
        "5.1, Fig 12",
        "A joystick moves the catheter forward and backward, left and right",
        "test_the_catheter_follows_the_stick_and_stops_without_messages in "
        "minorloop-head/tests/console/test_session.py; test_a_gamepad_steers in "
        "minorloop-head/tests/console/test_pages.py",
        "held to by the tests; left and right roll the catheter",
        "holds",
    ),
    (
        "5.1, Fig 12",
        "A motion tracker on the operator's head turns pan and tilt of the camera",
        "test_the_head_follows_the_tracker_and_not_the_page in "
        "minorloop-head/tests/console/test_tracker.py; "
        "test_the_head_goes_where_the_operator_looks in "
        "minorloop-head/tests/console/test_session.py",
        "held to by the tests; not with the tracker of the paper, but with the protocol of "
        "OpenTrack, a phone or a headset",
        "holds",
    ),
    (
        "5.1",
        "The commands of the camera are computed from attitude and direction of the head",
        "test_yaw_and_pitch_are_those_that_the_head_was_turned_by in "
        "minorloop-head/tests/console/test_head_pose.py",
        "held to by the test, to 1e-6 rad",
        "holds",
    ),
    (
        "5.1",
        "The attitude is scaled to lie within the cone of visibility",
        "test_no_pose_leads_out_of_the_cone and test_saturation_keeps_the_direction in "
        "minorloop-head/tests/console/test_head_pose.py",
        "held to by the tests, for random poses and cones",
        "holds",
    ),
    (
        "5.1",
        "The cone is that of the limits of the catheter head, scaled",
        "test_a_turn_by_the_reach_goes_to_the_edge_less_the_dead_band in "
        "minorloop-head/tests/console/test_head_pose.py",
        "45 degrees of the operator's head are 30 of the camera, less a dead band of 1 degree",
        "holds",
    ),
    (
        "5.1",
        "Commands of motion follow from the position of the joystick",
        "test_more_deflection_is_never_less_rate and "
        "test_no_number_asks_for_more_than_the_full_rate in "
        "minorloop-head/tests/console/test_joystick.py",
        "held to by the tests",
        "holds",
    ),
    (
        "5.1",
        "A button selects a reference point in the picture",
        "test_the_mouse_looks_picks_and_clutches in minorloop-head/tests/console/test_pages.py; "
        "test_a_pick_takes_what_is_known_near_it_and_follows_it in "
        "minorloop-head/tests/console/test_perception.py",
        "held to by the tests with a mouse; the button of a gamepad is not tested",
        "holds",
    ),
    (
        "5.1",
        "The head-mounted display shows the picture of the camera",
        "not tested: the emulated headset of the tests has no display to look at",
        "-",
        "not tested",
    ),
    (
        "6",
        "The operator's head moves nothing while the tracker is on",
        "test_in_track_the_operators_head_does_nothing in "
        "minorloop-head/tests/console/test_modes.py; "
        "test_the_operators_head_does_not_move_a_tracked_target in "
        "minorloop-head/tests/console/test_session.py",
        "held to by the tests; commands are equal to the bit",
        "holds",
    ),
)
"""Where in the paper, what it says, where it is tested, the result with names of figures, and
whether it holds."""


class _Results(Formatter):
    """Puts figures in the place of their dotted names, such as ``{fig8.ratio:.1f}``."""

    def get_field(self, field_name: str, args: Any, kwargs: Any) -> tuple[Any, str]:
        return figure(kwargs, field_name), field_name

    def format_field(self, value: float, format_spec: str) -> str:
        return cell(value, format_spec)


def _readable(where: str) -> str:
    """Return it with names of tests as words, so that a narrow column can break them."""
    return re.sub(r"\btest(_\w+)\b(?!\.py)", lambda m: f'"test{m[1]}"'.replace("_", " "), where)


def _said(verdict: Verdict, known: Mapping[str, Any]) -> str:
    if isinstance(verdict, str):
        return verdict
    held = [each(known) for each in (verdict if isinstance(verdict, tuple) else (verdict,))]
    if all(held):
        return "holds"
    return "holds in part" if any(held) else "does not hold here"


def add_sections(
    report: Report, figures: Mapping[str, Any], drawn: Mapping[str, Mapping[str, float]]
) -> None:
    """Add the table of statements.

    Parameters
    ----------
    report : Report
    figures : mapping
        Over all specimens.
    drawn : mapping
        Of controllers on the specimen that is drawn: ``least`` and ``most`` settling of the steps
        in s, and ``step_ms``, the median time of a step of the loop in ms.
    """
    known = {**figures, "drawn": drawn}
    report.add(
        "What sections 4 and 5.1 say",
        text="Each statement in our words, where it is tested, and the result, as medians over "
        "specimens unless it says otherwise. Sections are those of this report; tests are in the "
        "source of the project, where their names have underscores for spaces. A verdict compares "
        "figures of this run with each other, or with a bound of ours: 1.5 degrees rms for a "
        "model, 1.5 times for growth, 0.8 of the sway, 2 times between steps, 0.25 mm.",
        table=Table(
            ("in the paper", "statement", "tested in", "result", "verdict"),
            [
                (
                    place,
                    words,
                    _readable(where),
                    _Results().vformat(result, (), known),
                    _said(verdict, known),
                )
                for place, words, where, result, verdict in STATEMENTS
            ],
        ),
    )
