"""Every public module has a test file of its name, or is listed with the file that tests it."""

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PLACES = {
    "minorloop": (ROOT / "packages/minorloop/src/minorloop", ROOT / "packages/minorloop/tests"),
    "minorloop_head": (
        ROOT / "packages/minorloop-head/src/minorloop_head",
        ROOT / "packages/minorloop-head/tests",
    ),
    "papers": (ROOT / "papers", ROOT / "papers/tests"),
}
"""Source and tests of each package."""

ELSEWHERE = {
    "minorloop/drawing/lab.py": "minorloop/drawing/test_notebook.py",
    "minorloop/drawing/layout.py": "minorloop/drawing/test_notebook.py",
    "minorloop/drawing/linear.py": "minorloop/identification/test_linear_fit.py",
    "minorloop/drawing/oscillator.py": "minorloop/identification/test_oscillator.py",
    "minorloop/errors.py": "minorloop/test_public_names.py",
    "minorloop/figures.py": "minorloop/drawing/test_operators.py",
    "minorloop/identification/band_model.py": "minorloop/test_scoring.py",
    "minorloop/identification/linear_algebra.py": "minorloop/identification/test_dense_solver.py",
    "minorloop/identification/oscillator_result.py": "minorloop/identification/test_oscillator.py",
    "minorloop/identification/pipeline.py": "minorloop/identification/test_preparation.py",
    "minorloop/identification/record_checks.py": "minorloop/identification/test_refusals.py",
    "minorloop/identification/simulation_error.py": "minorloop/identification/test_oscillator.py",
    "minorloop/lab/headers.py": "minorloop/lab/test_columns.py",
    "minorloop/lab/text_tables.py": "minorloop/lab/test_columns.py",
    "minorloop/operators/tracker.py": "minorloop/operators/test_operator.py",
    "minorloop/page/admission.py": "minorloop_head/console/test_server.py",
    "minorloop/version.py": "minorloop/cli/test_main.py",
    "minorloop/cli/plan.py": "minorloop/cli/test_runs.py",
    "minorloop/devices.py": "minorloop/cli/test_devices.py",
    "minorloop/drawing/after_effect.py": "minorloop/drawing/test_notebook.py",
    "minorloop/drawing/dynamics.py": "minorloop/drawing/test_notebook.py",
    "minorloop/drive_report.py": "minorloop/cli/test_drive.py",
    "minorloop/identification/after_effect_result.py": (
        "minorloop/identification/test_after_effect.py"
    ),
    "minorloop/identification/alternation.py": "minorloop/identification/test_dynamics.py",
    "minorloop/identification/dynamic_search.py": "minorloop/identification/test_dynamics.py",
    "minorloop/identification/elimination_order.py": "minorloop/identification/test_active_set.py",
    "minorloop/identification/rough_model.py": "minorloop/identification/test_screening.py",
    "minorloop/page/process.py": "minorloop/page/test_workers.py",
    "minorloop/positioning_report.py": "minorloop/cli/test_demo.py",
    "minorloop_head/distortion.py": "minorloop_head/test_geometry.py",
    "minorloop_head/console/identified_head.py": "minorloop_head/console/test_loop.py",
    "minorloop_head/console/scan_echoes.py": "minorloop_head/console/test_depth_work.py",
    "minorloop_head/console/units.py": "minorloop_head/console/test_reports.py",
    "minorloop_head/control/head.py": "minorloop_head/control/test_head_control.py",
    "minorloop_head/inspection/heads.py": "minorloop_head/cli/test_head.py",
    "minorloop_head/inspection/identification.py": "minorloop_head/cli/test_head.py",
    "minorloop_head/inspection/inspect_pictures.py": "minorloop_head/cli/test_inspect.py",
    "minorloop_head/procedures/calibrate.py": "minorloop_head/cli/test_head.py",
    "minorloop_head/procedures/calibration.py": "minorloop_head/procedures/test_head_file.py",
    "minorloop_head/procedures/calibration_report.py": "minorloop_head/cli/test_head.py",
    "minorloop_head/procedures/inspected_view.py": "minorloop_head/procedures/test_inspection.py",
    "minorloop_head/procedures/ring.py": "papers/catheter/test_inspection_parts.py",
    "minorloop_head/procedures/target_pictures.py": "minorloop_head/cli/test_head.py",
    "minorloop_head/sources.py": "minorloop_head/vision/test_video.py",
    "minorloop_head/twins/mounted.py": "minorloop_head/twins/test_camera.py",
    "minorloop_head/twins/turbid_water.py": "minorloop_head/twins/test_camera.py",
    "minorloop_head/version.py": "tests/packaging/test_wheel.py",
    "minorloop_head/twins/pit_echo.py": "minorloop_head/twins/test_ultrasound.py",
    "minorloop_head/ultrasound/pit_model.py": "minorloop_head/ultrasound/test_pits.py",
    "minorloop_head/vision/crack_evidence.py": "minorloop_head/vision/test_cracks.py",
    "minorloop_head/vision/imaging.py": "minorloop_head/console/test_server.py",
    "minorloop_head/vision/measured.py": "minorloop_head/procedures/test_head_file.py",
    "minorloop_head/vision/new_mark.py": "minorloop_head/procedures/test_mark.py",
    "minorloop_head/vision/patch_pictures.py": "minorloop_head/vision/test_wall_angles.py",
    "minorloop_head/vision/print_target.py": "minorloop_head/cli/test_head.py",
    "minorloop_head/vision/wall_patches.py": "minorloop_head/vision/test_wall_angles.py",
    "papers/catheter/control/laws.py": "minorloop_head/control/test_controller.py",
    "papers/catheter/crack_scenes.py": "papers/catheter/test_crack_trials.py",
    "papers/catheter/detection.py": "papers/catheter/test_inspection_parts.py",
    "papers/catheter/head.py": "papers/catheter/test_head_study.py",
    "papers/catheter/head_loop.py": "papers/catheter/test_head_study.py",
    "papers/catheter/head_static.py": "papers/catheter/test_head_study.py",
    "papers/catheter/inspection.py": "papers/catheter/test_inspection_parts.py",
    "papers/catheter/mission.py": "papers/catheter/test_inspection_parts.py",
    "papers/catheter/picture_sensor.py": "papers/catheter/test_head_camera.py",
    "papers/catheter/sight.py": "papers/catheter/test_head_study.py",
    "papers/catheter/tracking_trials.py": "papers/catheter/test_head_study.py",
    "papers/catheter/control/adaptive.py": "minorloop_head/control/test_controller.py",
    "papers/catheter/control/model_reference.py": "minorloop_head/control/test_controller.py",
    "papers/catheter/scene_view.py": "minorloop_head/vision/test_defects.py",
    "papers/drawing.py": "papers/test_design.py",
    "papers/catheter/inspection_servo.py": "papers/catheter/test_inspection_parts.py",
}


def untested():
    """Public modules without a test file of their name."""
    return {
        f"{package}/{module.as_posix()}"
        for package, (source, tests) in PLACES.items()
        for path in source.rglob("*.py")
        if path.stem[0] != "_" and tests not in path.parents
        for module in [path.relative_to(source)]
        if not (tests / module.parent / f"test_{module.name}").exists()
    }


def test_every_module_without_a_test_file_of_its_name_is_listed():
    assert untested() == ELSEWHERE.keys()


@pytest.mark.parametrize("file", sorted(set(ELSEWHERE.values())))
def test_the_files_that_test_other_modules_exist(file):
    package, _, name = file.partition("/")
    assert (PLACES.get(package, (ROOT, ROOT / package))[1] / name).exists()
