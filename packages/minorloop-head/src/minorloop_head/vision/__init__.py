"""From pixels to rates and findings: the camera's geometry, servo, detection, tracking, focus."""
