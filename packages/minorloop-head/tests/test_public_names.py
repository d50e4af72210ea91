import minorloop_head


def test_the_public_names_are_these_and_can_be_imported():
    assert set(minorloop_head.__all__) == {
        *("HeadControl", "HeatedWire", "WireLimits", "head_control", "identify_heating"),
        *("moving_levels", "wire_holds", "HeadAddress", "drive_head", "identify_head"),
        *("inspect", "inspected_head", "sweep", "swept_head"),
        *("Course", "SimulatedFault", "Surroundings", "convection"),
        *("RecordedScan", "ScanFlaws", "read_scan", "scan_flaws"),
    }
    assert all(callable(getattr(minorloop_head, name)) for name in minorloop_head.__all__)
