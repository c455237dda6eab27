"""Going round what moves: prediction, encounters, ants in space and time, and the guard."""
