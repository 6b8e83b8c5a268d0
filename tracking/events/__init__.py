"""What happens before running cameras, as events that leave the machine."""
