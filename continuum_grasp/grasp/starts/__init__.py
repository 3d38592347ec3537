"""Starting points for the search, from geometry alone."""
