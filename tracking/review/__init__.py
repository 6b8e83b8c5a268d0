"""Results that a person looks through and corrects."""
