"""Files that are wrong in every way: what reads a user's or a stranger's files refuses them in words, soon, in little memory."""
