"""What every node is built on: lifecycle, executor loop, health, start plans."""
