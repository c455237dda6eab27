"""Every planner on the same seeded episodes, measured against the clairvoyant optimum."""
