"""What if: studies on the joint bench of questions that the thesis leaves open (its chapter 4)."""
