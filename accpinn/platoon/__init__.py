"""The platoon: learned vehicles in a row behind a leader, simulated exactly."""
