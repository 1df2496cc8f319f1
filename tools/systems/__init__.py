"""Other systems, Pythons and installations, made from nothing; `make test-systems` runs this project on them."""
