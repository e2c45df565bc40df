"""The whole loop: runner, recorder, exact hybrid automaton, experiments and reports."""
