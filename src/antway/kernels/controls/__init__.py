"""The space of controls: rollouts, what they cost, and the colony of ants that looks for good ones."""
