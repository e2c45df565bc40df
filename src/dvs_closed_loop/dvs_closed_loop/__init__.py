"""The whole loop: runner, recorder, reports, dashboard."""
