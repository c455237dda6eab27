"""Tours: many stops in the best order, some of them only at certain times."""
