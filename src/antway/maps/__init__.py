"""Map files in and out."""
