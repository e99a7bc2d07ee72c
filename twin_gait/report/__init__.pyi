from .canvas import put_legend as put_legend
from .canvas import readable as readable
from .canvas import save as save
from .canvas import style_panel as style_panel
