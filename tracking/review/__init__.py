"""Results corrected by a person: where the tracker was least certain, what the person says, and solving it again."""
