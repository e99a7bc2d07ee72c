from .cases import TransitionTest as TransitionTest
from .cases import approval_text as approval_text
from .cases import transition_tests as transition_tests
