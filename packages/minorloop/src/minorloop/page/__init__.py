"""The lab page, in a browser: its server, its uploads and its workers."""
