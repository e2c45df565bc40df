"""Monte Carlo sweeps over the exact automaton: resumable, on one machine or many."""
