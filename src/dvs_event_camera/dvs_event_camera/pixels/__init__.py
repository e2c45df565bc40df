"""The pixel model: levels in, threshold crossings out, ideal or imperfect, compiled or not."""
