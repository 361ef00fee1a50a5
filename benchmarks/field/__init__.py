"""Hidden effects in the field: several vehicles, engines, ways to fly and sensors, explained as a user would."""
