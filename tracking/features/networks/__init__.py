"""Detection and appearance by networks: exported ones, those of other projects, and any function."""
