# Puts the receiver on a mesh of two shapes, prints jawOpen at every frame for a minute, and ends.
extends SceneTree

var _face := MeshInstance.new()
var _left_s := 0.0


func _init() -> void:
	var mesh := ArrayMesh.new()
	mesh.add_blend_shape("JawOpen")
	mesh.add_blend_shape("eyeBlink_L")
	var arrays := []
	arrays.resize(Mesh.ARRAY_MAX)
	arrays[Mesh.ARRAY_VERTEX] = PoolVector3Array([Vector3(0, 0, 0), Vector3(1, 0, 0), Vector3(0, 1, 0)])
	var shape := []
	shape.resize(Mesh.ARRAY_MAX)
	shape[Mesh.ARRAY_VERTEX] = arrays[Mesh.ARRAY_VERTEX]
	mesh.add_surface_from_arrays(Mesh.PRIMITIVE_TRIANGLES, arrays, [shape, shape])
	_face.mesh = mesh
	_face.name = "face"
	root.add_child(_face)
	var receiver = load("res://fapengine_face_godot3.gd").new()
	receiver.address = OS.get_environment("FACE_ADDRESS")
	receiver.face_path = NodePath("/root/face")
	root.add_child(receiver)


func _idle(delta: float) -> bool:
	_left_s += delta
	print("jaw %f" % _face.get("blend_shapes/JawOpen"))
	if _left_s > 60.0:
		quit()
	return false
