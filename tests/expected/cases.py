"""All cases."""

from expected import console, inspections, judges, models, studies, verbs

CASES = (
    *verbs.CASES,
    *models.CASES,
    *console.CASES,
    *inspections.CASES,
    *judges.CASES,
    *studies.CASES,
)
