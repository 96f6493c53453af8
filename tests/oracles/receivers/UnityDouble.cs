// A stand-in for as much of UnityEngine as examples/receivers/FapengineFace.cs uses, and a program that runs it: prints
// jawOpen at every frame for a minute.
using System;
using System.Collections.Generic;
using System.Threading;

namespace UnityEngine
{
    public class MonoBehaviour { }
    public class TooltipAttribute : Attribute { public TooltipAttribute(string text) { } }
    public struct Quaternion
    {
        public static Quaternion identity;
        public static Quaternion Euler(float x, float y, float z) { return identity; }
        public static Quaternion operator *(Quaternion one, Quaternion other) { return one; }
    }
    public class Transform { public Quaternion localRotation; }
    public class Mesh
    {
        public string[] names;
        public int blendShapeCount { get { return names.Length; } }
        public string GetBlendShapeName(int number) { return names[number]; }
    }
    public class SkinnedMeshRenderer
    {
        public Mesh sharedMesh;
        public Dictionary<int, float> weights = new Dictionary<int, float>();
        public void SetBlendShapeWeight(int shape, float weight) { weights[shape] = weight; }
    }
}

public static class Program
{
    public static void Main(string[] arguments)
    {
        var mesh = new UnityEngine.Mesh { names = new[] { "Face.JawOpen", "eyeBlink_L" } };
        var renderer = new UnityEngine.SkinnedMeshRenderer { sharedMesh = mesh };
        var face = new FapengineFace { address = arguments[0], face = renderer };
        Call(face, "Start");
        for (DateTime until = DateTime.Now.AddSeconds(60); DateTime.Now < until; Thread.Sleep(16))
        {
            Call(face, "Update");
            float jaw;
            renderer.weights.TryGetValue(0, out jaw);
            Console.WriteLine("jaw " + (jaw / face.fullWeight).ToString(System.Globalization.CultureInfo.InvariantCulture));
        }
        Environment.Exit(0);
    }

    static void Call(object face, string name)   // as Unity does: they are private
    {
        var flags = System.Reflection.BindingFlags.Instance | System.Reflection.BindingFlags.NonPublic;
        face.GetType().GetMethod(name, flags).Invoke(face, null);
    }
}
