"""Every public module has a test file of its name, or is listed with the file that tests it."""

from pathlib import Path

import pytest

TESTS = Path(__file__).parent
SOURCE = TESTS.parent / "src/minorloop"

ELSEWHERE = {
    "identification/after_effect_result.py": "identification/test_after_effect.py",
    "drawing/lab.py": "lab/test_reduction.py",
    "drawing/layout.py": "drawing/test_dynamics.py",
    "drawing/linear.py": "identification/test_linear_fit.py",
    "drawing/oscillator.py": "identification/test_oscillator.py",
    "errors.py": "test_public_names.py",
    "figures.py": "drawing/test_operators.py",
    "head/console/admission.py": "head/console/test_server.py",
    "head/console/identified_head.py": "head/console/test_loop.py",
    "head/console/numbered_findings.py": "head/console/test_session.py",
    "head/console/outgoing.py": "head/console/test_session.py",
    "head/console/scan_echoes.py": "head/console/test_depth_work.py",
    "head/console/scanning.py": "head/console/test_session.py",
    "head/control/guard_log.py": "head/control/test_guard.py",
    "head/control/guard_state.py": "head/control/test_guard.py",
    "head/control/head.py": "head/control/test_head_control.py",
    "head/control/transient.py": "head/control/test_heating.py",
    "head/procedures/calibrate.py": "cli/test_head.py",
    "head/procedures/inspected_view.py": "head/procedures/test_inspection.py",
    "head/studies/calibration_scene.py": "cli/test_head.py",
    "head/studies/crack_report.py": "head/studies/test_crack_trials.py",
    "head/studies/crack_scans.py": "head/studies/test_crack_trials.py",
    "head/studies/crack_scenes.py": "head/studies/test_crack_trials.py",
    "head/studies/detection.py": "head/studies/test_inspection_parts.py",
    "head/studies/detection_report.py": "head/studies/test_inspection_parts.py",
    "head/studies/head.py": "head/studies/test_head_study.py",
    "head/studies/head_loop.py": "head/studies/test_head_study.py",
    "head/studies/head_report.py": "head/studies/test_head_study.py",
    "head/studies/head_static.py": "head/studies/test_head_study.py",
    "head/studies/inspection.py": "head/studies/test_inspection_parts.py",
    "head/studies/inspection_report.py": "head/studies/test_inspection_parts.py",
    "head/studies/judged.py": "head/test_judge.py",
    "head/studies/mission.py": "head/studies/test_inspection_parts.py",
    "head/studies/missions.py": "head/studies/test_inspection_parts.py",
    "head/studies/sweeps.py": "head/studies/test_sweep_trials.py",
    "head/studies/scans.py": "head/studies/test_inspection_parts.py",
    "head/studies/mission_cracks.py": "head/studies/test_inspection_parts.py",
    "head/studies/mission_scene.py": "head/studies/test_inspection_parts.py",
    "head/procedures/ring.py": "head/studies/test_inspection_parts.py",
    "head/studies/mission_report.py": "head/studies/test_inspection_parts.py",
    "head/studies/head_camera_report.py": "head/studies/test_head_study.py",
    "head/studies/picture_sensor.py": "head/studies/test_head_camera.py",
    "head/studies/servo_integral_report.py": "head/studies/test_servo_integral.py",
    "head/studies/sight.py": "head/studies/test_head_study.py",
    "head/studies/sight_report.py": "head/studies/test_head_study.py",
    "head/studies/sight_trials.py": "head/studies/test_head_study.py",
    "head/studies/touch_trials.py": "head/studies/test_head_study.py",
    "head/studies/tracking_trials.py": "head/studies/test_head_study.py",
    "head/twins/tool.py": "head/procedures/test_mark.py",
    "head/twins/turbid_water.py": "head/twins/test_camera.py",
    "head/ultrasound/wall_echoes.py": "head/ultrasound/test_c_scan.py",
    "head/vision/new_mark.py": "head/procedures/test_mark.py",
    "head/vision/patch_pictures.py": "head/vision/test_wall_angles.py",
    "head/vision/wall_patches.py": "head/vision/test_wall_angles.py",
    "head/vision/wall_views.py": "head/vision/test_tracking.py",
    "head/twins/mounted.py": "head/twins/test_camera.py",
    "head/vision/crack_evidence.py": "head/vision/test_cracks.py",
    "head/vision/imaging.py": "head/console/test_server.py",
    "head/vision/measured.py": "head/procedures/test_head_file.py",
    "identification/band_model.py": "test_scoring.py",
    "identification/gram_rows.py": "identification/test_design_matrix.py",
    "identification/oscillator_result.py": "identification/test_oscillator.py",
    "identification/simulation_error.py": "identification/test_oscillator.py",
    "lab/drivers/parts.py": "lab/drivers/test_bench.py",
    "lab/readings.py": "lab/test_reduction.py",
    "lab/text_tables.py": "lab/test_columns.py",
    "lab/wrapped_actuator.py": "lab/test_converted_actuator.py",
    "operators/operator.py": "dynamics/test_cascade.py",
    "studies/benchmark_report.py": "studies/test_benchmark.py",
    "studies/design_report.py": "studies/test_design.py",
    "studies/drawing.py": "studies/test_design.py",
    "studies/fibre_report.py": "studies/test_fibre.py",
    "studies/ipmc_report.py": "studies/test_ipmc.py",
    "studies/stage_report.py": "studies/test_stage.py",
    "version.py": "cli/test_main.py",
}


def untested():
    """Public modules without a test file of their name."""
    modules = (path.relative_to(SOURCE) for path in SOURCE.rglob("*.py") if path.stem[0] != "_")
    return {
        module.as_posix()
        for module in modules
        if not (TESTS / module.parent / f"test_{module.name}").exists()
    }


def test_every_module_without_a_test_file_of_its_name_is_listed():
    assert untested() == ELSEWHERE.keys()


@pytest.mark.parametrize("file", sorted(set(ELSEWHERE.values())))
def test_the_files_that_test_other_modules_exist(file):
    assert (TESTS / file).exists()
