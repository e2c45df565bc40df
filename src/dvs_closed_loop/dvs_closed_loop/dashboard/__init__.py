"""The live page of a running loop."""
