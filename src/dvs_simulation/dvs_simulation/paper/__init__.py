"""The paper regenerated: its experiments, tables and figures, and our corrections."""
