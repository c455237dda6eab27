"""What antway is compared with: other policies and planners behind the same interface."""
