"""The controller of the legs, behind one interface, and the trips of the safety monitor."""
