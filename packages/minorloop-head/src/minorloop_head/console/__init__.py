"""The console: teleoperation of the catheter's head in a browser, and the lab page."""
