"""When recordings and simulation differ: where, why, and by which physics."""
