"""Training and evaluating controllers, and the league table that compares them."""
