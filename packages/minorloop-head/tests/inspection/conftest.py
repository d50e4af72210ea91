"""An inspection as scripted, and a full disk."""

from scripted_inspection import full_disk, script, unreported  # noqa: F401
