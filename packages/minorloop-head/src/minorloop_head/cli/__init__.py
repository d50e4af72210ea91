"""The verbs that the head adds to the command line: one file a verb."""
