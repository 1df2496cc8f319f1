"""Every kernel that takes geometry, fed with the extremes of its range and one step beyond, against exact arithmetic."""
