"""Make the pictures and pages of the documents."""
