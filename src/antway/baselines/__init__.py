"""What antway is compared with: other policies behind the same interface."""
