"""Starting and watching the nodes of a loop."""
