"""Controller synthesis: unstructured, structured, certified, and what they are made of."""
