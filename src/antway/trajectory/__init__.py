"""Turns paths into motions: curves, stops at corners, speed profiles."""
