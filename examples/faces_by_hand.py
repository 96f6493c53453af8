"""Set FAPs by name and look at them: a surprised face, from the side, without a wall behind it."""

import fapengine

surprise = fapengine.FapTrack.pose(
    open_jaw=300, raise_b_midlip=-300, raise_b_lip_lm=-250, raise_b_lip_rm=-250, raise_b_midlip_o=-300,
    raise_b_lip_lm_o=-250, raise_b_lip_rm_o=-250, raise_l_i_eyebrow=180, raise_r_i_eyebrow=180,
    raise_l_m_eyebrow=200, raise_r_m_eyebrow=200, raise_l_o_eyebrow=150, raise_r_o_eyebrow=150,
    close_t_l_eyelid=-200, close_t_r_eyelid=-200,
)  # fmt: skip
drawing = fapengine.RenderOptions.parse(camera="three-quarter", background="none")
fapengine.save(surprise, "out/surprise.png", drawing=drawing)
print("see out/surprise.png")
