"""From a problem to a design: the tool, its reports, figures and files."""
