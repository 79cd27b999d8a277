"""Files written over time: their names, how they replace older ones, how many are kept; needs no engine."""
