"""Policy `paper`: Steps 1-8 of the paper."""
