"""The networks and their losses: torch only; they know no file, trainer or tracker."""
